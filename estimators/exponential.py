"""Exponential and logarithm of numbers or of lanes, without a call: a library's take one number at a time.

With k whole and |r| <= ln 2 / 2, and with m between the roots of 1/2 and 2 and z = m - 1,

    exp(k ln 2 + r) = 2^k (1 + 2 r P(r^2) / (Q(r^2) - r P(r^2)))
    log(m 2^e) = e ln 2 + z - z^2 / 2 + z^3 R(z) / S(z)

with the polynomials of Moshier (Cephes Mathematical Library), to the last but one place.
"""

import numpy as np

from estimators.kernel import kernel
from estimators.lanes import exponent, mantissa, power_of_two, select

_LN2, _LN2_REST = 6.93145751953125e-1, 1.42860682030941723212e-6
"""ln 2 in few bits, so that its products by whole numbers are exact, and what is left of it."""
_LN2_ABOVE, _LN2_EXCESS = 0.693359375, 2.121944400546905827679e-4
"""Likewise, rounded up."""
_WHOLE = 1.5 * 2.0**52
"""Added to a number and taken off it, it leaves the whole number next to it."""
_LEAST, _MOST = -708.0, 709.0
"""Exponents beyond which the exponential counts as zero, and as infinite."""


@kernel
def exponential(x: float) -> float:
    """Return e^x of numbers or of lanes; zero below -708, infinite above 709."""
    inside = select(x < _LEAST, _LEAST, select(x > _MOST, _MOST, x))
    k = (inside * 1.4426950408889634073599 + _WHOLE) - _WHOLE
    r = (inside - k * _LN2) - k * _LN2_REST
    square = r * r
    p = r * ((1.26177193074810590878e-4 * square + 3.02994407707441961300e-2) * square + 9.99999999999999999910e-1)
    q = (3.00198505138664455042e-6 * square + 2.52448340349684104192e-3) * square + 2.27265548208155028766e-1
    value = (1 + 2 * (p / (q * square + 2.00000000000000000005 - p))) * power_of_two(k)
    out: float = select(x < _LEAST, 0.0, select(x > _MOST, np.inf, value))
    return out


@kernel
def logarithm(x: float) -> float:
    """Return ln x of numbers or of lanes, positive and normal; NaN of what is not positive, or infinite."""
    m, e = mantissa(x), exponent(x)
    above = m > 1.41421356237309504880
    z, e = select(above, 0.5 * m, m) - 1, select(above, e + 1, e)
    p = (1.01875663804580931796e-4 * z + 4.97494994976747001425e-1) * z + 4.70579119878881725854
    p = ((p * z + 1.44989225341610930846e1) * z + 1.79368678507819816313e1) * z + 7.70838733755885391666
    q = ((z + 1.12873587189167450590e1) * z + 4.52279145837532221105e1) * z + 8.29875266912776603211e1
    q = (q * z + 7.11544750618563894466e1) * z + 2.31251620126765340583e1
    square = z * z
    rest = z * (square * p / q) - e * _LN2_EXCESS - 0.5 * square
    out: float = select((x > 0) & (x < np.inf), z + rest + e * _LN2_ABOVE, np.nan)
    return out
