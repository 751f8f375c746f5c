"""The description of a flight that telemetry and recording receive before its first period."""

from swarm.assets import find_model
from swarm.flight.builders import assumed_angle_noise, orbit, photodiodes, station_frame
from swarm.flight.flight import Flight
from swarm.results.scene import CcdScene, OrbitScene, Scene, StationScene
from swarm.scenario import Scenario
from swarm.units import si
from swarm.world.craft import visuals


def scene(scenario: Scenario, flight: Flight) -> Scene:
    """Return the scene of a flight, all of whose parts have been built."""
    world, limits, faults = flight.world, scenario.navigation.integrity, flight.faults.names
    pairs = () if flight.sensors.ccd is None else flight.sensors.ccd.pairs
    return Scene(
        craft=world.names,
        visuals=[world.visuals(i) for i in range(len(world.names))],
        photodiodes=photodiodes(scenario, world),
        lighthouse=visuals(find_model(scenario.lighthouse.model)),
        field_deg=scenario.lighthouse.field_deg,
        detail=scenario.recording.detail,
        ccd=[
            CcdScene(
                pair.craft,
                pair.target,
                pair.cameras.position_m,
                pair.cameras.rotation,
                pair.lights.point_m,
                pair.settings.field_rad,
            )
            for pair in pairs
        ],
        lidar=[(observer.craft, observer.target) for observer in flight.computer.inspection.observers],
        watched=bool(faults) or limits.alert_position_mm is not None or limits.alert_attitude_deg is not None,
        actuated=flight.actuators.any,
        guided=flight.pilot.guidance is not None,
        docking=bool(flight.latches.matings),
        faults=faults,
        stations=[
            StationScene(
                table.name,
                at.rotation,
                at.position,
                "2.0" if table.second else "1.0",
                -1 if table.craft is None else scenario.craft_names.index(table.craft),
            )
            for table, at in ((table, station_frame(table)) for table in scenario.station)
        ],
        up=scenario.recording.up,
        pairs=flight.computer.navigator.settings.relations.pairs,
        orbit=_orbit(scenario),
        physics=flight.steps.sentence(),
        angle_noise_rad=assumed_angle_noise(scenario).sigma_rad,
    )


def _orbit(scenario: Scenario) -> OrbitScene | None:
    table, relative = scenario.orbit, orbit(scenario)
    if table is None or relative is None:
        return None
    own = si(table)
    return OrbitScene(own.altitude_m, relative.mean_motion_rad_s, relative.axes, own.sun_beta_rad, own.sun_phase_rad)
