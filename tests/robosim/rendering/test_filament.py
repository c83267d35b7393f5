"""Filament: a scene's light, shadow and grains where it can draw, and what is missing where it cannot."""

from types import SimpleNamespace

import mujoco
import numpy as np
import pytest

from robosim.episode.film import FilmStyle, choose_renderer
from robosim.rendering import filament
from robosim.rendering.filament import APT_COMMAND, FilamentRenderer, FilamentUnavailable, Grains, find_device
from robosim.rendering.views import Window

SCENE = """<mujoco><worldbody><geom type="plane" size="1 1 0.1" rgba="0.5 0.5 0.5 1"/>
<body mocap="true" pos="0 0 0.3"><geom type="box" size="0.1 0.1 0.01" rgba="0.9 0.1 0.1 1"/></body>
<camera name="above" pos="0 0 2" xyaxes="1 0 0 0 1 0" fovy="45"/></worldbody></mujoco>"""
HEIGHT, WIDTH = 240, 320


def can_draw() -> bool:
    """Whether this machine has MuJoCo 4 and a Vulkan device."""
    try:
        find_device()
    except FilamentUnavailable:
        return False
    return True


@pytest.fixture
def no_memory() -> object:
    """find_device asks anew, before and after."""
    find_device.cache_clear()
    yield
    find_device.cache_clear()


@pytest.mark.usefixtures("no_memory")
def test_what_is_missing_is_named(monkeypatch: pytest.MonkeyPatch) -> None:
    """The version of MuJoCo, or the packages of a Vulkan device; a film is then drawn by OpenGL unless it may not."""
    monkeypatch.setattr(mujoco, "mj_version", lambda: 3_017_000)
    with pytest.raises(FilamentUnavailable, match="Filament needs MuJoCo 4, and "):
        choose_renderer(FilmStyle(renderer="filament"))
    monkeypatch.setattr(mujoco, "mj_version", lambda: 4_000_001)
    monkeypatch.setattr(filament.subprocess, "run", lambda *_, **__: SimpleNamespace(returncode=1))
    with pytest.raises(FilamentUnavailable, match=f"no Vulkan device.*{APT_COMMAND}"):
        choose_renderer(FilmStyle(renderer="filament"))
    assert choose_renderer(FilmStyle()) == choose_renderer(FilmStyle(renderer="classic")) == ""


@pytest.mark.usefixtures("no_memory")
@pytest.mark.parametrize(("device", "text"), [
    ("llvmpipe (LLVM 15.0.6, 256 bits)", "Filament, llvmpipe (LLVM 15.0.6, 256 bits) on the processor"),
    ("NVIDIA H200", "Filament, NVIDIA H200")])
def test_a_page_names_the_device_that_drew(monkeypatch: pytest.MonkeyPatch, device: str, text: str) -> None:
    """By what Filament writes when it has chosen one: a program answers to a request for hardware, too."""
    monkeypatch.setattr(mujoco, "mj_version", lambda: 4_000_001)
    monkeypatch.setattr(filament.importlib, "import_module", lambda _: None)
    said = f"Selected physical device '{device}' from 1 physical devices. (vendor 0x10005)"
    monkeypatch.setattr(filament.subprocess, "run", lambda *_, **__: SimpleNamespace(returncode=0, stdout=said,
                                                                                    stderr=""))
    assert choose_renderer(FilmStyle()) == text


def test_light_shadow_and_grains() -> None:
    """Seen from above: the plate, its shadow to the side that the light goes, and grains where they are put."""
    if not can_draw():
        pytest.skip("no MuJoCo 4 with a Vulkan device")
    model = mujoco.MjModel.from_xml_string(SCENE)
    data = mujoco.MjData(model)
    renderer = FilamentRenderer(model, Grains(500, 0.01, (1.0, 1.0, 1.0)), WIDTH, HEIGHT)
    bare = renderer.draw(data, None, "above").astype(int)
    plate = (bare[..., 0] > bare[..., 2] + 50)
    rows, columns = np.nonzero(plate)
    assert abs(rows.mean() - HEIGHT / 2) < 3 and abs(columns.mean() - WIDTH / 2) < 3
    grey = bare.sum(2)
    middle = np.zeros_like(plate)  # the picture is darker towards its corners
    middle[HEIGHT // 4 : 3 * HEIGHT // 4, WIDTH // 4 : 3 * WIDTH // 4] = True
    shadow = middle & ~plate & (grey < 0.75 * np.median(grey))
    rows, columns = np.nonzero(shadow)
    assert rows.mean() < HEIGHT / 2 - 3 and columns.mean() < WIDTH / 2 - 3  # the light goes to +y, up, and to -x, left
    heap = np.random.default_rng(0).uniform(-0.05, 0.05, (500, 3)) + [0.4, -0.3, 0.06]
    with_heap = renderer.draw(data, heap, "above").astype(int)
    rows, columns = np.nonzero((with_heap - bare).min(2) > 30)
    scale = HEIGHT / (2 * (2.0 - 0.06) * np.tan(np.radians(22.5)))  # pixels a metre at the heap
    assert abs(columns.mean() - (WIDTH / 2 + 0.4 * scale)) < 5 and abs(rows.mean() - (HEIGHT / 2 + 0.3 * scale)) < 5
    assert np.abs(renderer.draw(data, None, "above").astype(int) - bare).max() < 10
    part = Window(64, 160, 96, 288)  # the middle of the plate, its shadow and the heap
    one = renderer.begin(data, heap, "above", part)().astype(int)
    differs = np.abs(one - with_heap[part.rows, part.columns]).max(2)
    assert one.shape == (*part.shape, 3) and differs.mean() < 2.0 and (differs > 16).mean() < 0.02
    renderer.close()
