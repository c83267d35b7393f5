# Pinocchio is compiled and ships no types: every name is Any, and robosim's own types are still checked.
from typing import Any

def __getattr__(name: str) -> Any: ...
