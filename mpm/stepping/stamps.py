"""Numbers of substeps: blocks of the grid that are active in a substep carry its number as a stamp."""

from mpm.state.active_blocks import wrap_stamp


class Stamps:
    """Hands out numbers that no substep has had."""

    def __init__(self) -> None:
        self.last = 0
        """Number of the last substep."""
        self.is_listed = False
        """Whether the blocks of the next substep are on the grid's list."""

    @property
    def next(self) -> int:
        """Number of the next substep."""
        return self.last + 1

    def restart(self) -> None:
        """Skip a number: blocks that the last advance listed for its next substep carry it."""
        self.last += 1

    def pass_substeps(self, count: int) -> None:
        """Count substeps whose blocks were listed as they ran."""
        self.last = wrap_stamp(self.last + count)

    def take(self, count: int) -> int:
        """Return the first of `count` numbers that no substep has had; what is on the grid's list is void."""
        self.is_listed = False
        first = wrap_stamp(self.last + 2)  # blocks that the last advance listed carry the one after its own
        self.last = wrap_stamp(first + count - 1)
        return first
