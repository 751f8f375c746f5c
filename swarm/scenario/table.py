"""The base of every table of a scenario, and the types of its values.

A table is frozen, refuses unknown keys, converts nothing silently and knows no infinity. A key carries its unit as a
suffix; `swarm.units.si` converts a table to SI units. Validators are built when a table is first used.
"""

from collections.abc import Callable, Iterator, Mapping
from typing import Annotated, Any, ClassVar, Self

from pydantic import BaseModel, ConfigDict, Field, Strict, ValidationError, model_validator
from pydantic_core import PydanticCustomError

from swarm.errors import SwarmError, did_you_mean
from swarm.scenario.limits import (
    ACCELERATION,
    DISTANCE,
    LENGTH,
    MOMENT,
    POSITION,
    PROBABILITY,
    PROCESS,
    SPEED,
    SPIN,
    TURNING_PROCESS,
    VELOCITY,
)

Component = Annotated[float, Field(ge=-1000, le=1000), POSITION]
Speed = Annotated[float, Field(ge=-100, le=100), VELOCITY]
Rate = Annotated[float, Field(ge=-3600, le=3600), SPIN]
Extent = Annotated[float, Field(ge=0, le=1000), DISTANCE]
Length = Annotated[float, Field(ge=1e-6, le=1000), LENGTH]
Time = Annotated[float, Field(ge=0, le=86400), MOMENT]
Pace = Annotated[float, Field(ge=1e-6, le=100), SPEED]
"""A speed without a direction, which is not zero."""
Acceleration = Annotated[float, Field(ge=1e-6, le=100), ACCELERATION]
ProcessNoise = Annotated[float, Field(ge=1e-9, le=100), PROCESS]
TurningNoise = Annotated[float, Field(ge=1e-9, le=36000), TURNING_PROCESS]
Probability = Annotated[float, Field(ge=0, le=1), PROBABILITY]
Velocity = Annotated[tuple[Speed, Speed, Speed], Strict(False)]
AngularRate = Annotated[tuple[Rate, Rate, Rate], Strict(False)]
Vector = Annotated[tuple[Component, Component, Component], Strict(False)]
"""Three numbers; a TOML list becomes a tuple (hence not strict), its elements stay strict."""
Box = Annotated[tuple[Length, Length, Length], Strict(False)]
"""The size of a box along x, y, z."""

TINY = 1e-9
"""Least size, in its own unit, of a number that may also be zero: the square of one such as 1e-300 is no number."""
Mistake = tuple[str, ...]
"""A mistake between several keys: a message, the key to blame, and the others that could be changed instead."""


Explain = Callable[[ValidationError, Mapping[str, Any], "type[Table]"], str]


def _as_pydantic_says(error: ValidationError, data: Mapping[str, Any], table: "type[Table]") -> str:
    return str(error)


class Table(BaseModel):
    """One TOML table: frozen, no unknown key, no silent conversion, no infinity.

    explain: words the mistakes in a table that Python code makes. `swarm.scenario.mistakes` words them by the keys of
    all tables, so it stands above this file, which cannot import it, and puts its function here.
    """

    explain: ClassVar[Explain] = staticmethod(_as_pydantic_says)

    model_config = ConfigDict(extra="forbid", frozen=True, strict=True, allow_inf_nan=False, defer_build=True)

    def __init__(self, /, **data: Any) -> None:
        """Take the values of all keys. Raises SwarmError where one is wrong."""
        try:
            self.__pydantic_validator__.validate_python(data, self_instance=self)
        except ValidationError as error:
            raise SwarmError(Table.explain(error, data, type(self))) from None

    # As for pydantic's own: within a table, tables are made without a call.
    __init__.__pydantic_base_init__ = True  # type: ignore[attr-defined]

    def __setattr__(self, name: str, value: Any) -> None:
        """Refuse: a table does not change."""
        if name not in type(self).model_fields:
            raise SwarmError(f"{type(self).__name__}.{name}: unknown key{did_you_mean(name, type(self).model_fields)}")
        raise SwarmError(
            f"{type(self).__name__}.{name}: a scenario does not change; load it with the other value, "
            f'load("formation", ["duration_s=10"]), or make a copy, model_copy(update={{"{name}": ...}})'
        )

    def between_keys(self) -> Iterator[Mistake]:
        """Yield every mistake that lies between several keys, each of them good by itself."""
        yield from ()

    def _tiny(self) -> Iterator[Mistake]:
        """Yield every number that is not negative and so near to zero that nobody can have meant it."""
        for key, field in type(self).model_fields.items():
            value = getattr(self, key)
            if (
                isinstance(value, float)
                and 0 < value < TINY
                and any(getattr(m, "ge", None) == 0 for m in field.metadata)
            ):
                yield f"must be 0, or at least {TINY:g}: smaller numbers leave the arithmetic's range", key

    @model_validator(mode="after")
    def _check_between_keys(self) -> Self:
        if mistakes := [*self._tiny(), *self.between_keys()]:
            raise PydanticCustomError("between_keys", "{text}", {"text": mistakes[0][0], "mistakes": mistakes})
        return self
