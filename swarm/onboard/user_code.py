"""Code of a user on board: called with whatever happens in it told by one message, and its answers checked.

my_controller.py, line 14: craft 'craft-2' at 3.250 s: ZeroDivisionError: float division by zero
"""

from collections.abc import Callable
from typing import Any

import numpy as np

from estimators.arrays import Floats
from swarm.errors import SwarmError
from swarm.plugin_files import PlugIn, line_of, told


def called(plug_in: PlugIn, where: str, function: Callable[..., Any], *arguments: Any) -> Any:
    """Call code of a user, and return what it returns.

    Args:
        plug_in: the class that the code belongs to.
        where: craft and time, for the message.
        function: the code.
        *arguments: its arguments.

    Raises:
        SwarmError: the code has raised anything but a stop by the user; the message names the user's own line.
    """
    try:
        return function(*arguments)
    except (Exception, SystemExit) as error:
        raise SwarmError(f"{plug_in.said}{line_of(error, plug_in.file)}: {where}: {told(error)}") from error


def numbers(plug_in: PlugIn, where: str, name: str, value: Any, shape: tuple[int, ...]) -> Floats:
    """Return an answer of a user's code as floats.

    Args:
        plug_in: the class that has answered.
        where: craft and time, for the message.
        name: the name of the value.
        value: the value.
        shape: the shape that is asked for.

    Raises:
        SwarmError: the value has another shape, or is not finite.
    """
    try:
        array = np.array(value, dtype=np.float64)
    except (TypeError, ValueError):
        raise SwarmError(
            f"{plug_in.said}: {where}: {name} must be numbers of shape {shape}, not {type(value).__name__}"
        ) from None
    if array.shape != shape:
        raise SwarmError(f"{plug_in.said}: {where}: {name} must be numbers of shape {shape}, not {array.shape}")
    if not np.isfinite(array).all():
        raise SwarmError(f"{plug_in.said}: {where}: {name} has values that are not finite")
    return array


def at(craft: str, time_s: float) -> str:
    """Return craft and time as messages name them."""
    return f"craft {craft!r} at {time_s:.3f} s"
