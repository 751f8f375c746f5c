"""The base of every table of a scenario, and the types of its values.

A table is frozen, refuses unknown keys, converts nothing silently and knows no infinity. A key carries its unit as a
suffix; `swarm.units.si` converts a table to SI units. Validators are built when a table is first used.
"""

from collections.abc import Iterator
from typing import Annotated, Self

from pydantic import BaseModel, ConfigDict, Field, Strict, model_validator
from pydantic_core import PydanticCustomError

from swarm.scenario.limits import DISTANCE, LENGTH, MOMENT, POSITION, SPIN, VELOCITY

Component = Annotated[float, Field(ge=-1000, le=1000), POSITION]
Speed = Annotated[float, Field(ge=-100, le=100), VELOCITY]
Rate = Annotated[float, Field(ge=-3600, le=3600), SPIN]
Extent = Annotated[float, Field(ge=0, le=1000), DISTANCE]
Length = Annotated[float, Field(ge=1e-6, le=1000), LENGTH]
Time = Annotated[float, Field(ge=0, le=86400), MOMENT]
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


class Table(BaseModel):
    """One TOML table: frozen, no unknown key, no silent conversion, no infinity."""

    model_config = ConfigDict(extra="forbid", frozen=True, strict=True, allow_inf_nan=False, defer_build=True)

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
