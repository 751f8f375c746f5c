"""The arc tangent of numbers or of lanes, without a call: a library's takes one number at a time.

With n over d brought below tan(pi/8) by a turn of pi/4 or pi/2, and u the square of what remains, x,

    atan x = x + x u P(u) / Q(u)

with the polynomials of Moshier (Cephes Mathematical Library), to the last but one place.
"""

from estimators.kernel import kernel
from estimators.lanes import select

_FAR, _HALFWAY = 2.41421356237309504880, 0.66
"""Tangents beyond which n over d is turned by pi/2, and by pi/4."""
_QUARTER, _LEFT = 0.78539816339744830962, 3.061616997868382943065e-17
"""pi/4, and what its number lacks of it."""


@kernel
def arc_tangent(n: float, d: float) -> float:
    """Return the arc tangent of n over d [rad], d > 0, of numbers or of lanes."""
    size = select(n < 0, -n, n)
    far, halfway = size > _FAR * d, size > _HALFWAY * d
    x = select(far, -d, select(halfway, size - d, size)) / select(far, size, select(halfway, size + d, d))
    turns = select(far, 2.0, select(halfway, 1.0, 0.0))
    u = x * x
    p = -8.750608600031904122785e-1 * u - 1.615753718733365076637e1
    p = ((p * u - 7.500855792314704667340e1) * u - 1.228866684490136173410e2) * u - 6.485021904942025371773e1
    q = (u + 2.485846490142306297962e1) * u + 1.650270098316988542046e2
    q = ((q * u + 4.328810604912902668951e2) * u + 4.853903996359136964868e2) * u + 1.945506571482613964425e2
    angle = _QUARTER * turns + (x * (u * p / q) + x + _LEFT * turns)
    return select(n < 0, -angle, angle)
