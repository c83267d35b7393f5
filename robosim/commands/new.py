"""`robosim new`: a commented configuration file to start from."""

import argparse
import math
import re
from pathlib import Path
from typing import Any

from robosim.base.errors import ConfigError, note
from robosim.base.files import write_text
from robosim.base.resources import config_names, config_path, locate_paths, part_names, part_path
from robosim.commands.keys import KINDS, import_name

EXAMPLE = """examples:
  robosim new rehearsal lab --from spoon
  robosim new material oats --from sugar
  robosim new arm lab_description/urdf/lab.urdf
then, after editing the file,
  robosim rehearse lab.yaml --material oats.yaml --out out/lab"""
BASES = {"rehearsal": "spoon", "task": "SpoonPour", "material": "salt", "arm": "iiwa14"}
"""Kind of file -> the bundled one that it is a copy of, if no other is given."""
USES = {"rehearsal": "robosim rehearse {}", "task": "robosim evaluate {}", "material": "--material {}",
        "arm": "robosim rehearse spoon --set robot={}"}
"""Kind of file -> what takes it."""
MODELS = (".urdf", ".xml", ".mjcf", ".xacro")
FLANGES = ("tool0", "flange", "attachment_site", "ee_link", "tcp", "link_eef", "panda_link8", "fr3_link8", "right_hand")
"""Usual names of the place where a hand is mounted, the most usual first."""
FINGER = re.compile("finger|jaw|claw|thumb|knuckle", re.IGNORECASE)
HAND = re.compile(f"{FINGER.pattern}|grip|hand", re.IGNORECASE)
"""What names of a hand's bodies have in them; of its joints and fixed bodies: a wrist's link may be `gripper`."""


def add_parser(commands: Any) -> None:
    """Add `new` to the command line."""
    parser = commands.add_parser("new", help="write a commented configuration file to start from", epilog=EXAMPLE,
                                 description="Write NAME.yaml: a copy of a bundled file in which a comment explains "
                                 "every key, including those with their default. An existing file is not replaced.")
    parser.add_argument("kind", choices=list(BASES), help="kind of file")
    parser.add_argument("name", type=Path, metavar="NAME", help="path of the new file; .yaml is added; "
                        "of an arm also a URDF or MJCF file, beside which its .yaml is written")
    parser.add_argument("--from", dest="basis", metavar="BASIS",
                        help="bundled file to copy, or the path of a .yaml file "
                        "(default: " + ", ".join(f"{name} for a {kind}" for kind, name in BASES.items()) + ")")
    parser.set_defaults(run=run)


def run(options: argparse.Namespace) -> int:
    """Write the file."""
    kind, path, basis = options.kind, options.name, options.basis or BASES[options.kind]
    if kind == "arm" and path.is_dir() and (models := sorted(str(model) for model in path.rglob("*.urdf"))):
        raise ConfigError(f"{path}: a folder; accepted: a model in it: {', '.join(models)}")
    is_model = kind == "arm" and path.suffix.lower() in MODELS
    if is_model and options.basis:
        raise ConfigError(f"--from {options.basis} with a model, {path}; accepted: one of them")
    source = path if is_model else find_source(kind, basis)
    if path.suffix not in (".yaml", ".yml"):
        path = path.with_suffix(".yaml") if is_model else Path(f"{path}.yaml")
    if path.exists():
        raise ConfigError(f"{path}: exists already and is left as it is; give another name, or remove it")
    if not path.parent.is_dir():
        raise ConfigError(f"{path}: there is no folder {path.parent}; accepted: a name in an existing folder")
    if path.stem in bundled_names(kind) and path.parent == Path():
        print(f"note: {path.stem} without .yaml still means the bundled {kind}")
    from robosim.commands.description import template
    from robosim.config.materials import load_material
    from robosim.config.table import load, read

    schema = type(load_material(str(source))) if kind == "material" else import_name(KINDS[kind])
    if not is_model:
        load(source, schema)  # refuses a file that is not valid
    table, joints, missing = draft_arm(source) if is_model else (locate_paths(read(source), source.parent), (), {})
    made = source.name if is_model else f"{path.stem} --from {basis}"
    heading = (f"{'An' if kind == 'arm' else 'A'} {kind}, made by `robosim new {kind} {made}`; used by "
               f"`{USES[kind].format(str(path))}`. In brackets: accepted values; default. "
               f"A key after a # has its default; to change it, remove the #.")
    text = template(schema, table, heading)
    if is_model:
        print(f"flange: {table['flange']}, at the end of {', '.join(joints)}")
    for key, lacking in missing.items():
        print(f"to fill in: limits.{key} of {', '.join(lacking)}")
        text = text.replace(f"\n  {key}: ", f"\n  # To fill in: {', '.join(lacking)}; null: as in the model\n  {key}: ")
    write_text(path, text)
    print(path)
    return 0


def draft_arm(path: Path) -> tuple[dict[str, Any], tuple[str, ...], dict[str, list[str]]]:
    """Return what the model of an arm says for its file, its joints, and limit -> joints of which it does not say it;
    raises ConfigError."""
    from robosim.config.arm import ArmConfig
    from robosim.config.table import validate
    from robosim.robot.mjspec import read_model
    from robosim.robot.robot import SLIDE, collect_limits, read_chain

    spec = read_model(path)
    flange = guess_flange(spec)
    joints = tuple(joint.name for joint in read_chain(spec, flange, 0.0, path)[1])
    table: dict[str, Any] = {"model": path.name, "flange": flange, "payload": None}
    limits, _, missing = collect_limits(spec.compile(), joints, validate(table, path, ArmConfig), path)
    far = [f"{name} from {lower:.4g} to {upper:.4g}" for name, lower, upper in zip(joints, limits["lower"],
           limits["upper"]) if max(-lower, upper) > 4.0 * math.pi and spec.joint(name).type != SLIDE]
    if far:
        note(f"{path}: ranges beyond two turns: {', '.join(far)} rad; are these degrees?")
    table["limits"] = {key: [None if key.endswith("_deg") or value != value else float(value) for value in
                             limits.get(key, joints)] for key in missing}
    return table, joints, missing


def guess_flange(spec: Any) -> str:
    """Return a site or body of a model with a usual name, or else the last body behind the most joints of no hand.
    A hand begins where it is named, and behind as many joints as an arm has where one slides or several bodies move."""
    from robosim.config.arm import LEAST_JOINTS
    from robosim.robot.robot import SLIDE

    names = [part.name for part in (*spec.sites, *spec.bodies)]
    behind = {"world": 0}
    for body in spec.bodies[1:]:
        number = behind.get(body.parent.name, -1)
        is_hand = FINGER.search(body.name) or any(HAND.search(part.name) for part in body.joints or [body])
        if number >= LEAST_JOINTS and body.joints:
            beside = sum(bool(one.joints) for one in body.parent.bodies) > 1
            is_hand = is_hand or beside or body.joints[0].type == SLIDE
        if number == 0 or (number > 0 and not is_hand):
            behind[body.name] = number + len(body.joints)
    return next((name for name in FLANGES if name in names), max(reversed(behind), key=behind.__getitem__))


def bundled_names(kind: str) -> list[str]:
    """Return the names of the bundled files of a kind."""
    return part_names("robots") if kind == "arm" else config_names(f"{kind}s")


def find_source(kind: str, basis: str) -> Path:
    """Return the file to copy; raises ConfigError, UnknownName."""
    return part_path("robots", basis, kind) if kind == "arm" else config_path(f"{kind}s", basis, kind)
