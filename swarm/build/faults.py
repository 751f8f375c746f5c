"""From a scenario's `[[fault]]` tables to what goes wrong in its run."""

from swarm.build.cameras import craft_keys
from swarm.errors import SwarmError
from swarm.faults.injection import Faults
from swarm.layout import Photodiodes
from swarm.scenario import Scenario
from swarm.scenario.faults import PhotodiodeDead, PhotodiodeStuck
from swarm.sensors.lighthouse import Lighthouse
from swarm.sensors.visibility import Visibility


def faults(settings: Scenario, lighthouse: Lighthouse, visibility: Visibility) -> Faults | None:
    """Everything that goes wrong; None where nothing does. Raises SwarmError as `check_faults`."""
    if not settings.fault:
        return None
    check_faults(settings, lighthouse.photodiodes)
    keys, flown = craft_keys(settings), (settings.seed, settings.duration_s)
    return Faults(settings.fault, settings.craft_names, keys, *flown, lighthouse, visibility)


def check_faults(settings: Scenario, layout: Photodiodes) -> None:
    """Raises SwarmError, naming scenario, key and value, where a craft has no such photodiode."""
    names = settings.craft_names
    for i, fault in enumerate(settings.fault):
        if not isinstance(fault, PhotodiodeDead | PhotodiodeStuck):
            continue
        for name in fault.craft or names:
            count = int(layout.present[names.index(name)].sum())
            if max(fault.photodiodes) >= count:
                raise SwarmError(
                    f"scenario {settings.name}: fault[{i}].photodiodes: there is no number {max(fault.photodiodes)}: "
                    f"craft {name!r} has {count}, counted from 0"
                )
