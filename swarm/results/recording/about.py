"""The text behind the recording's tab *What is what*."""

from swarm.results.recording.craft import TRAIL_POINTS, TRAIL_STEP_S
from swarm.results.recording.estimates import ENLARGED
from swarm.results.recording.lighthouse import FAN_TURN_S, REAL_FAN_TURN_S
from swarm.results.scene import Scene

LIDARS = """| yellow points | the last scan of a LiDAR, where its craft believes the returns to be |
"""
CAMERAS = """| blue, yellow line | from the main and the backup camera to a light that it sees |
| pyramids on a craft | the fields of its cameras |
"""
ORBIT = """| arrows at the lighthouse | to the Earth, along the flight, and to the sun if that is said |
| view *Orbit* | the Earth in true size, its night side dark, and the lighthouse on its orbit, in 1000 km |
"""
CROWD = """| colour of a craft | its position error: blue within 1 mm, teal 3 mm, green 10 mm, yellow 30 mm, orange \
beyond; red: searching, dark orange: coasting, purple: ambiguous, grey: without sensors |
| white label | the worst craft of the last two seconds: the longest without tracking, or the largest error |
"""
RAYS = """| green ray, point | photodiode lit by the lighthouse |
| red ray, point | photodiode in reach, but something stands in between |
"""
DEAD = """| black point | photodiode that does not answer: a fault |
"""
STATIONS = """| line from a station | its light went into the craft's filter in this period; in the colour of its fans |
| green point | photodiode lit by a station |
| red point | photodiode in reach of a station, but something stands in between |
"""
AXES = "The axes are those of the lighthouse: x right (red), y down (green), z forward (blue)."
STATION_AXES = "Every station has axes of its own: x right (red), y down (green), z forward (blue)."
ABOUT = """# What is drawn

| | |
|---|---|
| solid craft | {craft} |
| outline | where its filter believes it is |
| ellipsoid | the filter's 3 sigma of position, **enlarged {enlarged} times**, to half a metre at most |
{light}{dead}| grey point | photodiode outside field or range, or turned away |
| two translucent fans | {whose} lasers, **slowed down {slowed:.0f} times** |
{crowd}{cameras}| thin trail | where the craft was in the last {trail:.0f} s |

To hide the fans, the rays or anything else, open the panel on the left (the buttons are at the top right), and click
the eye beside `fans` or `{rays}`.

{axes}

# Plots

*Errors* are distances and angles from the truth; below the *3σ* line the filter deserves its confidence.
*NEES* is the squared error over the filter's own covariance: 6 on average if it is consistent; the band holds 95 % of
the values of independent craft. *ADOP* and *PDOP* say how much attitude and position suffer from angle noise. A
*protection level* is what the craft says its error is below, false photodiodes included.
{physics}"""


def about(scene: Scene, crowd: bool) -> str:
    """Return the text for a scene, as Markdown. crowd: most craft are drawn as one."""
    return ABOUT.format(
        craft="the craft at its estimate: the truth is not known" if scene.replay else "the craft where it truly is",
        enlarged=ENLARGED,
        rays="light" if scene.stations else "rays",
        dead=DEAD if any("photodiode-dead" in each for each in scene.faults) else "",
        light=STATIONS if scene.stations else RAYS,
        whose="a station's" if scene.stations else "the lighthouse's",
        axes=STATION_AXES if scene.stations else AXES,
        slowed=FAN_TURN_S / REAL_FAN_TURN_S,
        crowd=CROWD if crowd else "",
        trail=TRAIL_POINTS * TRAIL_STEP_S,
        physics=f"\n# Physics\n\n{scene.physics}\n" if scene.physics else "",
        cameras=(CAMERAS if scene.ccd else "") + (LIDARS if scene.lidar else "") + (ORBIT if scene.orbit else ""),
    )
