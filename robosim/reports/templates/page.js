for (const head of document.querySelectorAll(".sorts th")) head.onclick = () => {
  const table = head.closest("table"), k = [...head.parentNode.children].indexOf(head);
  const up = head.dataset.up = head.dataset.up === "1" ? "0" : "1";
  const key = row => row.children[k].dataset.value ?? row.children[k].textContent;
  const rows = [...table.tBodies[0].rows].sort((a, b) => {
    const x = key(a), y = key(b), n = Number(x) - Number(y);
    return (Number.isNaN(n) ? x.localeCompare(y) : n) * (up === "1" ? 1 : -1);
  });
  table.tBodies[0].append(...rows);
};
// A scene in 3-D keeps a core busy: it begins only when it is asked for.
for (const button of document.querySelectorAll(".scene button")) button.onclick = () => {
  const frame = button.nextElementSibling;
  frame.hidden = false;
  frame.srcdoc = frame.dataset.document;
  button.remove();
};
