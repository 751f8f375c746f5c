"""The stations as the craft know them in a period: where they stand, the errors of their fans, and their noise."""

from collections.abc import Sequence

from estimators.lighthouse.innovation import StationArrays, light_of
from estimators.lighthouse.integrity import AngleNoise
from estimators.lighthouse.rows import Packed, Station, packed


class KnownStations:
    """Stations whose places and noise may change from period to period.

    stations: places and fans of S stations; those that ride on craft are replaced in every period. noise: of the rows
    of each. packed, light: both as kernels take them.
    """

    packed: Packed
    light: StationArrays

    def __init__(self, stations: Sequence[Station], noise: Sequence[AngleNoise]) -> None:
        """Begin with stations where they stand.

        Args:
            stations: all of them.
            noise: of each.
        """
        self.stations, self.noise = list(stations), list(noise)
        self.place()

    def place(self) -> None:
        """Take the stations to be where `stations` says now."""
        self.packed = packed(self.stations)
        self.light = light_of(self.packed, self.noise)

    def assume(self, noise: Sequence[AngleNoise]) -> None:
        """Take the rows of every station to have this noise."""
        self.noise = list(noise)
        self.light = light_of(self.packed, self.noise)
