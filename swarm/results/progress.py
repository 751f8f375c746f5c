"""The progress of a run, told while it flies."""

from typing import NamedTuple


class Progress(NamedTuple):
    """The state of a run: time_s of duration_s [s] are simulated, and `tracking` of `craft` craft have their pose.

    duration_s: infinite where nobody knows when it ends. notice: a sentence for the user, such as why there is no live
    view.
    """

    time_s: float
    duration_s: float
    tracking: int
    craft: int
    notice: str | None = None
