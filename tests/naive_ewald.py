"""Brute-force grand mobility (11N, 11N) of spheres in the sheared cell: two plain lattice sums, every pair and mode.

The default is the classical split (Hasimoto 1959; Fiore & Swan 2019): true form factors sin k/k and 3 j1(k)/k in
the wave part, H(k) = (1 + k^2/4 xi^2) exp(-k^2/4 xi^2), real part decaying like exp(-xi^2 (r - 2)^2). It shares
no formula with the package's splits. a = 1, units 6 pi eta0 a^n; rows [U W E] and columns [F T S] of each sphere,
E and S in the orthonormal basis of five.
"""

import math
from collections import namedtuple
from fractions import Fraction

import numpy as np
from scipy.special import spherical_jn

ALPHA = {"FF": Fraction(1, 3), "FD": Fraction(4, 15), "DD": Fraction(1, 5)}
# functions(r) -> (n, 7) of the real part; own: real part's self mobility (F, T, S); weight(k), force(k) and
# dipole(k): wave part W, and the factors of F and C
Sum = namedtuple("Sum", "functions own reach weight force dipole kmax")


def five_basis():
    r2, r6 = math.sqrt(2), math.sqrt(6)
    basis = np.zeros((5, 3, 3))
    basis[0] = np.diag([1, -1, 0]) / r2
    basis[1] = np.diag([-1, -1, 2]) / r6
    for n, (i, j) in enumerate([(0, 1), (0, 2), (1, 2)]):
        basis[2 + n, i, j] = basis[2 + n, j, i] = 1 / r2
    return basis


def load_tensors():
    """Force (11, 3) and dipole C_qp = S_qp - eps_qpk T_k/2 (11, 3, 3) of the eleven unit loads."""
    force, dipole = np.zeros((11, 3)), np.zeros((11, 3, 3))
    force[:3] = np.eye(3)
    for k in range(3):
        i, j = (k + 1) % 3, (k + 2) % 3
        dipole[3 + k, i, j], dipole[3 + k, j, i] = -0.5, 0.5
    dipole[6:] = five_basis()
    return force, dipole


# --- total mobility of two spheres, overlapping or not, in exact arithmetic --------------------------------


def _product(a, b):
    """Product of sums of exp(i k (w + v r)) k^-m r^-p, {(w, v, m, p): (re, im)}."""
    out = {}
    for (w, v, m, p), (x, y) in a.items():
        for (w2, v2, m2, p2), (x2, y2) in b.items():
            key = (w + w2, v + v2, m + m2, p + p2)
            re, im = out.get(key, (0, 0))
            out[key] = (re + x * x2 - y * y2, im + x * y2 + y * x2)
    return out


def _sum(*terms):
    out = {}
    for factor, term in terms:
        for key, (x, y) in term.items():
            re, im = out.get(key, (0, 0))
            out[key] = (re + factor * x, im + factor * y)
    return out


def _sine(w, v, m, p):
    half = Fraction(1, 2)
    return {(w, v, m, p): (0, -half), (-w, -v, m, p): (0, half)}


def _cosine(w, v, m, p):
    half = Fraction(1, 2)
    return {(w, v, m, p): (half, 0), (-w, -v, m, p): (half, 0)}


def _half_line(expression):
    """(3/pi) int_0^inf dk of a real even expression for 0 < r < 2, {power of r: coefficient}.

    int_-inf^inf exp(i k x) k^-m dk = i pi sgn(x) (i x)^(m-1)/(m-1)! (finite part; the parts' infinities cancel).
    """
    out = {}
    for (w, v, m, p), (x, y) in expression.items():
        sign = (w > 0) - (w < 0) or (v > 0) - (v < 0)  # w = 0 or |w| >= 2 > r
        i_m = ((1, 0), (0, 1), (-1, 0), (0, -1))[m % 4]
        assert x * i_m[1] + y * i_m[0] == 0
        factor = Fraction(3 * sign, 2 * math.factorial(m - 1)) * (x * i_m[0] - y * i_m[1])
        for q in range(m):
            term = factor * math.comb(m - 1, q) * w ** (m - 1 - q) * v**q
            out[q - p] = out.get(q - p, 0) + term
    return {power: value for power, value in sorted(out.items()) if value}


def overlap_polynomials():
    """a(r) and b(r) for r < 2, weights j0^2 (FF), j0 s1 (FD), s1^2 (DD): {'FF': (a, b), ..}, exact."""
    j0 = _sine(1, 0, 1, 0)
    s1 = _sum((3, _sine(1, 0, 3, 0)), (-3, _cosine(1, 0, 2, 0)))
    j1_over = _sum((1, _sine(0, 1, 3, 3)), (-1, _cosine(0, 1, 2, 2)))  # j1(kr)/(kr)
    a, b = _sum((1, _sine(0, 1, 1, 1)), (-1, j1_over)), _sum((2, j1_over))
    weight = {"FF": _product(j0, j0), "FD": _product(j0, s1), "DD": _product(s1, s1)}
    return {n: (_half_line(_product(w, a)), _half_line(_product(w, b))) for n, w in weight.items()}


def seven(a, da, dda, b):
    """f1 f2 g1 g2 h1 h2 h3 (n, 7) from {'FF': value (n,), ..} of a, a', a'' and (b, for FD and DD (b - a)/r,
    (b - a)/r^2).
    """
    f = [a["FF"], b["FF"], -da["FD"], -b["FD"], -b["DD"], da["DD"] - dda["DD"], da["DD"] + 4 * b["DD"]]
    return np.stack(f, axis=1)


def _laurent(terms, r, shift=0, derivatives=0):
    total = np.zeros_like(r)
    for power, value in terms.items():
        factor = float(value) * math.prod(power - d for d in range(derivatives))
        total += factor * r ** (power - derivatives - shift)
    return total


def total_functions(r):
    """The seven functions of the total mobility; a'/r in the place of a' for DD (see `seven`)."""
    inside = overlap_polynomials()
    out = np.empty((len(r), 7))
    for part in (r < 2, r >= 2):
        if not part.any():
            continue
        a, da, dda, b = {}, {}, {}, {}
        for n, alpha in ALPHA.items():
            pa, pb = ({-1: 0.75, -3: 1.5 * alpha}, {-1: 1.5, -3: -3 * alpha})
            if r[part][0] < 2:
                pa, pb = inside[n]
            pd = {p: pb.get(p, 0) - pa.get(p, 0) for p in {*pa, *pb}}
            pd = {p: v for p, v in pd.items() if v}
            s = r[part]
            a[n], dda[n] = _laurent(pa, s), _laurent(pa, s, derivatives=2)
            da[n] = _laurent(pa, s, derivatives=1, shift=n == "DD")
            b[n] = _laurent(pb, s) if n == "FF" else _laurent(pd, s, shift=1 if n == "FD" else 2)
        out[part] = seven(a, da, dda, b)
    return out


# --- radial functions of a wave part by quadrature ----------------------------------------------------------


def wave_functions(r, weights, kmax, nodes=None):
    """Seven functions of the wave part with weights(k) -> {'FF': .., 'FD': .., 'DD': ..}, and its self values.

    a = (3/pi) int W [j0 - j1/(kr)], b = (3/pi) int W 2 j1/(kr), derivatives of the Bessel functions by
    recurrence; Gauss-Legendre on [0, kmax].
    """
    x, w = np.polynomial.legendre.leggauss(nodes or int(80 + kmax * (2 + r.max(initial=0.0))))
    k, w = 0.5 * kmax * (x + 1), 1.5 / np.pi * kmax * w
    values = weights(k)
    z = np.outer(r, k)
    j0, j1, j2, j3 = (spherical_jn(n, z) for n in range(4))
    a, da, dda, b = {}, {}, {}, {}
    for n in ALPHA:
        q = w * values[n]
        over = 1 if n == "FD" else 2
        a[n] = (j0 - j1 / z) @ q
        da[n] = (-j1 + j2 / z) @ (q * k) / (r if n == "DD" else 1)
        # d/dx (-j1 + j2/x) = -(j1/x - j2) + (2 j2/x - j3)/x - j2/x^2
        dda[n] = (-j1 / z + j2 + (2 * j2 / z - j3) / z - j2 / z**2) @ (q * k**2)
        b[n] = 2 * (j1 / z) @ q if n == "FF" else j2 @ q / r**over
    square = float(w * values["DD"] @ k**2)
    own = np.array([w @ values["FF"] * 2 / 3, square / 6, square / 5])
    return seven(a, da, dda, b), own


def classical(xi, error=1e-14):
    """The classical split at xi, truncated where its Gaussians are below `error`."""
    width = math.sqrt(-math.log(error))
    kmax = 2 * xi * (width + 0.5)

    def hasimoto(k):
        return (1 + (k / xi) ** 2 / 4) * np.exp(-((k / xi) ** 2) / 4)

    def force(k):
        return np.sinc(k / np.pi)

    def dipole(k):
        return 3 * spherical_jn(1, k) / k

    def weights(k):
        h, f, d = hasimoto(k), force(k), dipole(k)
        return {"FF": h * f * f, "FD": h * f * d, "DD": h * d * d}

    def functions(r):
        return total_functions(r) - wave_functions(r, weights, kmax)[0]

    own = np.array([1, 0.75, 0.9]) - wave_functions(np.ones(1), weights, kmax)[1]
    return Sum(functions, own, 2 + (width + 0.5) / xi, hasimoto, force, dipole, kmax)


# --- lattice sums ---------------------------------------------------------------------------------------------


def pair_blocks(d, functions):
    """Mobility (n, 11, 11) of sphere i due to j with d = x_i - x_j (n, 3), from the velocity and its gradient."""
    r = np.linalg.norm(d, axis=1)
    e = d / r[:, None]
    f1, f2, g1, g2, h1, h2, h3 = (c[:, None, None] for c in functions(r).T)
    force, c = load_tensors()
    one, ee = np.eye(3), np.einsum("ni,nj->nij", e, e)[:, None]
    ef = np.einsum("ni,li->nl", e, force)[..., None]
    ce, cte = np.einsum("lij,nj->nli", c, e), np.einsum("lji,nj->nli", c, e)
    ece = np.einsum("nli,ni->nl", ce, e)[..., None]
    x = e[:, None, :]
    u = f1 * force + (f2 - f1) * x * ef + g1 * (ce - ece * x) + g2 * (cte - 4 * ece * x)
    g1, g2, h1, h2, h3, ef, ece = (v[..., None] for v in (g1, g2, h1, h2, h3, ef, ece))

    def outer(p, q):
        return np.einsum("nlp,nlq->nlpq", np.broadcast_to(p, ce.shape), np.broadcast_to(q, ce.shape))

    gradient = -g1 * (outer(x, force) - ef * ee) - g2 * (one * ef + outer(force, x) - 4 * ef * ee)
    gradient += h1 * (c - 4 * c.transpose(0, 2, 1)) + h2 * (outer(x, ce) - ece * ee)
    gradient += h3 * (one * ece + outer(ce + cte, x) + outer(x, cte) - 6 * ece * ee - c.transpose(0, 2, 1))
    return np.einsum("ki,nli->nkl", force, u) + np.einsum("kqp,nlpq->nkl", c, gradient)


def images(lattice, reach):
    """Lattice vectors (m, 3) that can bring two points of one cell within `reach`."""
    m = [math.ceil(reach * s) + 1 for s in np.linalg.norm(np.linalg.inv(lattice), axis=0)]
    n = np.stack(np.meshgrid(*[np.arange(-i, i + 1) for i in m], indexing="ij"), axis=-1).reshape(-1, 3)
    return n @ lattice


def real_part(position, lattice, split):
    number = len(position)
    matrix = np.zeros((number, number, 11, 11))
    own = np.diag(np.repeat(split.own, (3, 3, 5)))
    shifts = images(lattice, split.reach)
    inverse = np.linalg.inv(lattice)
    for i in range(number):
        for j in range(i, number):
            d = position[i] - position[j]
            d = d - np.floor(d @ inverse) @ lattice + shifts
            d = d[(np.sum(d * d, axis=1) < split.reach**2) & (np.sum(d * d, axis=1) > 1e-20)]
            if len(d):
                matrix[i, j] = pair_blocks(d, split.functions).sum(axis=0)
            matrix[j, i] = matrix[i, j].T
        matrix[i, i] += own
    return matrix.transpose(0, 2, 1, 3).reshape(11 * number, 11 * number)


def modes(lattice, kmax):
    """Reciprocal vectors 0 < |k| <= kmax, one of each pair k, -k."""
    reciprocal = 2 * np.pi * np.linalg.inv(lattice).T
    m = [math.ceil(kmax * s / (2 * np.pi)) for s in np.linalg.norm(lattice, axis=1)]
    n = np.stack(np.meshgrid(*[np.arange(-i, i + 1) for i in m], indexing="ij"), axis=-1).reshape(-1, 3)
    n = n[len(n) // 2 + 1 :]  # the second half, without 0
    k = n @ reciprocal
    return k[np.sum(k * k, axis=1) <= kmax**2]


def wave_part(position, lattice, split):
    """Gram matrix: (6 pi/V) sum_k W/k^2 conj(f).(I - kk).f, f = e^{-ik.x} [F force(k) - i k_p C_qp dipole(k)]."""
    number = len(position)
    force, c = load_tensors()
    matrix = np.zeros((11 * number, 11 * number))
    every = modes(lattice, split.kmax)
    for k in np.array_split(every, 1 + len(every) // 2000):
        s = np.linalg.norm(k, axis=1)
        f = split.force(s)[:, None, None] * force - 1j * split.dipole(s)[:, None, None] * np.einsum("np,lqp->nlq", k, c)
        f = f - np.einsum("nlq,nq,np->nlp", f, k, k) / (s * s)[:, None, None]
        f *= np.sqrt(2 * 6 * np.pi / abs(np.linalg.det(lattice)) * split.weight(s))[:, None, None] / s[:, None, None]
        phase = np.exp(-1j * k @ position.T)
        full = np.einsum("nj,nlq->nqjl", phase, f).reshape(-1, 11 * number)
        matrix += full.real.T @ full.real + full.imag.T @ full.imag
    return matrix


def grand_mobility(position, edge, tilt, split=None):
    """Grand mobility (11N, 11N); `split` defaults to the classical one at xi = 1.1."""
    lattice = np.array([[edge, 0.0, 0.0], [tilt * edge, edge, 0.0], [0.0, 0.0, edge]])
    split = split or classical(1.1)
    return real_part(position, lattice, split) + wave_part(position, lattice, split)
