"""The case of small holes, at the choices of a quick report."""

import pytest

from robosim.studies.verification.cases.granular import small_hole


@pytest.mark.slow
def test_small_holes_pass_what_the_law_says_on_every_cell() -> None:
    records = [small_hole.measure(ratio=choices["ratio"], cell=choices["cell"]) for choices in small_hole.QUICK_SWEEP]
    findings = [claim.evaluate(records) for claim in small_hole.CLAIMS]
    assert [finding.verdict for finding in findings] == ["pass"] * 3, findings
