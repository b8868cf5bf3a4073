"""Exact resistance functions of two equal rigid no-slip spheres: twin multipoles, and their limit at contact.

Each sphere carries the Lamb multipoles P_n (pressure), V_n (potential) and Q_n (vorticity) of azimuthal order
m = 0, 1, 2; the field of the other sphere is re-expanded about its centre. Jeffrey & Onishi (J. Fluid Mech.
139, 261, 1984) and Jeffrey (Phys. Fluids A 4, 16, 1992) solve the recurrences as power series in a/r. Here
the truncated linear system itself is solved at each distance. It converges like exp(-2 n alpha) with
cosh(alpha) = r/2a, without any fitted or subtracted term. For equal spheres mirror symmetry splits it.

Functions are in the order of `FUNCTIONS` and in the hatted normalisation of Jeffrey & Onishi: 6 pi eta a
for A, 4 pi eta a^2 for B and G, 8 pi eta a^3 for C and H, (20/3) pi eta a^3 for M; loads are exerted by the
spheres on the fluid, e points from the sphere of the row to the other. Lengths are in radii; gap = r - 2.
"""

from __future__ import annotations

import math

import numpy as np

from suspend.errors import NumericalError

FUNCTIONS = (
    "XA11", "XA12", "YA11", "YA12", "YB11", "YB12", "XC11", "XC12", "YC11", "YC12",
    "XG11", "XG12", "YG11", "YG12", "YH11", "YH12", "XM11", "XM12", "YM11", "YM12", "ZM11", "ZM12",
)  # fmt: skip
TRUNCATION = 20.0  # the last multipole is about exp(-2 TRUNCATION) of the first

# (g1, g2, g3) for 11 and for 12 in f = g1/gap + g2 ln(1/gap) + C + g3 gap ln(1/gap) + ...: Jeffrey & Onishi
# (1984) and Jeffrey (1992) at equal radii. g3 of YM12 is .1272 (some codes have .1332): a test fits all g3.
CONTACT = {
    "XA": ((1 / 4, 9 / 40, 3 / 112), (-1 / 4, -9 / 40, -3 / 112)),
    "YA": ((0.0, 1 / 6, 0.0), (0.0, -1 / 6, 0.0)),
    "YB": ((0.0, -1 / 4, -1 / 8), (0.0, 1 / 4, 1 / 8)),
    "XC": ((0.0, 0.0, -1 / 8), (0.0, 0.0, 1 / 8)),
    "YC": ((0.0, 1 / 5, 47 / 250), (0.0, 1 / 20, 31 / 500)),
    "XG": ((3 / 8, 27 / 80, 117 / 560), (-3 / 8, -27 / 80, -117 / 560)),
    "YG": ((0.0, 1 / 8, 1 / 16), (0.0, -1 / 8, -1 / 16)),
    "YH": ((0.0, 1 / 40, 137 / 2000), (0.0, 1 / 10, 113 / 2000)),
    "XM": ((3 / 20, 27 / 200, 353 / 2800), (3 / 20, 27 / 200, 493 / 2800)),
    "YM": ((0.0, 3 / 25, 57 / 2500), (0.0, 3 / 100, 159 / 1250)),
    "ZM": ((0.0, 0.0, -3 / 40), (0.0, 0.0, 3 / 40)),
}


def contact_coefficients() -> np.ndarray:
    """Analytic g1, g2, g3 of all functions at contact, (3, 22), hatted normalisation."""
    return np.array([CONTACT[name[:2]][name.endswith("12")] for name in FUNCTIONS]).T


def number_of_terms(gap: float) -> int:
    """Multipoles for double precision at a gap (radii)."""
    return math.ceil(TRUNCATION / math.acosh(1.0 + gap / 2.0)) + 20


def scaled_binomials(s: float, terms: int, dtype=np.float64) -> np.ndarray:
    """C(n+k, n) s^-(n+k) for n, k = 1..terms, built outwards from the diagonal where it is largest."""
    n = np.arange(1, terms + 1, dtype=dtype)
    row = np.arange(terms)
    table = np.empty((terms, terms), dtype)
    diagonal = np.cumprod(2 * n * (2 * n - 1) / (n * n) / dtype(s) ** 2)
    for offset in range(terms):
        here = row[: terms - offset]
        table[here, here + offset] = diagonal
        table[here + offset, here] = diagonal
        m = n[: terms - offset - 1]
        diagonal = diagonal[:-1] * (2 * m + offset + 1) / (m + offset + 1) / dtype(s)
    return table


def couplings(s: float, m: int, terms: int, dtype=np.float64) -> dict[str, np.ndarray]:
    """Matrices by which the multipoles of one sphere excite those of the other, order m.

    With sign = (-1)^(m+1) x parity (parity +1: the sum of the responses of both spheres, -1: the difference)
        P = source + sign (PP P + PV V + PQ Q),  V = P + sign VP P,  Q = source + sign (QQ Q + QP P).
    The last letter is the exciting kind; rows n, columns k. Jeffrey & Onishi (1984), section 4, for any m.
    """
    n = np.arange(1, terms + 1, dtype=dtype)[:, None]
    k = n.T
    t = 1 / dtype(s)
    b = scaled_binomials(s, terms, dtype)
    for j in range(1, m + 1):  # C(n+k, n) -> C(n+k, n+m)
        b *= (k - j + 1) / (n + j)
    number = n * k * (n + k - 2 * n * k - 2) - m * m * (2 * n * k - 4 * k - 4 * n + 2)
    direct = (2 * n + 1) * number / (2 * (n + 1) * k * (2 * k - 1) * (n + k))
    return {
        "PP": b * (direct / t + n * (2 * n - 1) / (2 * (n + 1)) * t),
        "PV": b * (n * (4 * n * n - 1) / (2 * (n + 1) * (2 * k + 1)) * t),
        "PQ": -m * b * (2 * (4 * n * n - 1) / (3 * (n + 1))),
        "VP": b * (2 * n / ((n + 1) * (2 * n + 3)) * t),
        "QQ": b * (k / (n + 1) * t),
        "QP": -m * b * (3 / (2 * n * k * (n + 1))),
    }


def axisymmetric_residual(
    c: dict[str, np.ndarray], parity: int, source: np.ndarray, p: np.ndarray
) -> np.ndarray:
    """Residual of the P equations at m = 0 in the precision of the couplings `c`."""
    p = p.astype(c["PP"].dtype)
    v = p - parity * (c["VP"] @ p)
    return source - p - parity * (c["PP"] @ p + c["PV"] @ v)


def solve_axisymmetric(s: float, terms: int) -> tuple[np.ndarray, np.ndarray]:
    """Responses (P_1, P_2) x (source P_1, P_2) at m = 0: parts of the same sphere (11) and the other (12).

    Squeezing makes the system ill conditioned at small gaps, so two refinements in extended precision follow.
    """
    c = couplings(s, 0, terms)
    exact = couplings(s, 0, terms, np.longdouble)
    source = np.eye(terms, 2)
    product = c["PV"] @ c["VP"]
    response = {}
    for parity in (1, -1):
        inverse = np.linalg.inv(np.eye(terms) + parity * (c["PP"] + c["PV"]) - product)
        p = (inverse @ source).astype(np.longdouble)
        for _ in range(2):
            p = p + inverse @ axisymmetric_residual(exact, parity, source, p).astype(np.float64)
        response[parity] = p[:2].astype(np.float64)
    return (response[1] + response[-1]) / 2, (response[1] - response[-1]) / 2


def solve_azimuthal(s: float, m: int, terms: int) -> tuple[np.ndarray, np.ndarray]:
    """Responses at m = 1, (P_1, Q_1, P_2) x sources of the same, or m = 2, (P_2) x (P_2): parts 11 and 12."""
    c = couplings(s, m, terms)
    product = c["PV"] @ c["VP"]
    first = m - 1  # there is no multipole n < m
    rows = [0, terms, 1] if m == 1 else [0]
    response = {}
    for parity in (1, -1):
        sign = parity * (-1) ** (m + 1)
        matrix = np.eye(2 * terms)
        matrix[:terms, :terms] -= sign * (c["PP"] + c["PV"]) + product
        matrix[:terms, terms:] = -sign * c["PQ"]
        matrix[terms:, :terms] = -sign * c["QP"]
        matrix[terms:, terms:] -= sign * c["QQ"]
        kept = np.r_[first:terms, terms + first : 2 * terms]
        matrix = matrix[np.ix_(kept, kept)]
        response[parity] = np.linalg.solve(matrix, np.eye(len(kept))[:, rows])[rows]
    return (response[1] + response[-1]) / 2, (response[1] - response[-1]) / 2


def twisting(gap: float) -> tuple[float, float]:
    """XC11 and XC12: sums over image rotlets, sinh^3(alpha)/sinh^3(k alpha), k odd, even (Jeffery 1915)."""
    alpha = math.acosh(1.0 + gap / 2.0)
    k = np.arange(1, math.ceil(TRUNCATION / alpha) + 20)
    terms = (math.sinh(alpha) / np.sinh(np.minimum(k * alpha, 300.0))) ** 3
    return float(terms[0::2].sum()), float(-terms[1::2].sum())


def resistance_functions(gap: float, terms: int | None = None) -> np.ndarray:
    """Exact functions (22,) at a gap (radii) with `terms` multipoles (default: enough for double precision).

    Raises NumericalError below 1e-4, where the dense system grows beyond reason: there `NearContact` holds.
    """
    if not gap >= 1e-4:
        raise NumericalError(
            f"two-sphere multipoles: gap {gap!r} radii is below 1e-4; use the expansion at contact there"
        )
    s = 2.0 + gap
    terms = number_of_terms(gap) if terms is None else terms
    f = dict(zip(("XC11", "XC12"), twisting(gap), strict=True))
    for suffix, x in zip(("11", "12"), solve_axisymmetric(s, terms), strict=True):
        sign = 1.0 if suffix == "11" else -1.0
        f["XA" + suffix] = sign * x[0, 0]
        f["XG" + suffix] = sign * 0.75 * x[1, 0]
        f["XM" + suffix] = x[1, 1]
    for suffix, y in zip(("11", "12"), solve_azimuthal(s, 1, terms), strict=True):
        sign = 1.0 if suffix == "11" else -1.0
        f["YA" + suffix] = sign * y[0, 0]
        f["YB" + suffix] = sign * 2.0 * y[1, 0]
        f["YC" + suffix] = y[1, 1]
        f["YG" + suffix] = sign * 0.75 * y[2, 0]
        f["YH" + suffix] = -0.375 * y[2, 1]
        f["YM" + suffix] = y[2, 2]
    for suffix, z in zip(("11", "12"), solve_azimuthal(s, 2, terms), strict=True):
        f["ZM" + suffix] = z[0, 0]
    return np.array([f[name] for name in FUNCTIONS])


class NearContact:
    """Expansion at small gaps: g1/gap + g2 L + g3 gap L + sum of C, gap, gap^2 L, gap^2, ..., L = ln(1/gap).

    g1, g2, g3 are analytic (`CONTACT`); the other coefficients are fitted to exact values in `window`.
    """

    window = (1e-3, 5e-2)
    samples = 24

    def __init__(self, samples: int | None = None, window: tuple[float, float] | None = None):
        low, high = self.window if window is None else window
        gaps = np.geomspace(low, high, self.samples if samples is None else samples)
        exact = np.array([resistance_functions(gap) for gap in gaps])
        self.singular = contact_coefficients()
        rest = exact - self.singular_part(gaps)
        self.coefficients = np.linalg.lstsq(self.regular_basis(gaps), rest, rcond=None)[0]

    def singular_part(self, gap: np.ndarray) -> np.ndarray:
        """The analytic terms g1, g2, g3, (..., 22)."""
        gap = np.asarray(gap, dtype=float)[..., None]
        g1, g2, g3 = self.singular
        return g1 / gap - (g2 + g3 * gap) * np.log(gap)

    @staticmethod
    def regular_basis(gap: np.ndarray) -> np.ndarray:
        """Columns 1, x, x^2 L, x^2, x^3 L, x^3, x^4 L, x^4 at gap x."""
        x = np.asarray(gap, dtype=float)
        log = -np.log(x)
        return np.stack([x**0, x, x**2 * log, x**2, x**3 * log, x**3, x**4 * log, x**4], axis=-1)

    def __call__(self, gap: float) -> np.ndarray:
        """The functions (22,) at a gap (radii) up to about the start of the fitted window."""
        return self.singular_part(gap) + self.regular_basis(gap) @ self.coefficients
