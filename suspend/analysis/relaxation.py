"""How D_cyc decays: power law or exponential, its relaxation strain, and whether a run is absorbing or diffusing."""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cached_property
from typing import Any, Self

import numpy as np
from scipy.optimize import least_squares

from suspend.analysis.activity import position_error
from suspend.analysis.displacements import CyclicDiffusivity
from suspend.analysis.quantity import Quantity
from suspend.errors import ConfigurationError
from suspend.io import Run

LEAST_CYCLES = 8  # for the choice between decays
_START = 0.05  # of the run
_EXACT = 1e-7  # rms residual of ln D below which a fit counts as exact
_LARGEST_EXPONENT = 5.0  # a power law steeper than this cannot be told from an exponential
_SHAPES = {  # name: (family, decaying parameters, plateau)
    "steady": ("steady", 0, True),
    "exponential": ("exponential", 2, False),
    "exponential + plateau": ("exponential", 2, True),
    "power law": ("power law", 3, False),
    "power law + plateau": ("power law", 3, True),
}


@dataclass(frozen=True)
class DecayFit:
    """One form of D_cyc(gamma_tot), fitted to ln D_cyc.

    initial, plateau : D_0 and D_inf of D = D_0 f + D_inf (0 where absent); strain : the scale tau in
    f = exp(-gamma_tot/tau) or (1 + gamma_tot/tau)^-exponent; residual : rms of ln D; criterion : BIC.
    """

    name: str
    initial: float
    plateau: float
    strain: float
    exponent: float
    residual: float
    criterion: float = math.nan

    @property
    def family(self) -> str:
        """steady, exponential or power law."""
        return _SHAPES[self.name][0]

    @property
    def parameters(self) -> int:
        """Number of fitted parameters."""
        return _SHAPES[self.name][1] + _SHAPES[self.name][2]

    @property
    def relaxation_strain(self) -> float:
        """Total strain after which D - D_inf has fallen to 1/e of its value at 0; NaN for a steady run."""
        if self.family == "power law":
            return self.strain * math.expm1(1.0 / self.exponent)
        return self.strain

    def __call__(self, total_strain: np.ndarray) -> np.ndarray:
        """D_cyc at the given total strain."""
        total_strain = np.asarray(total_strain, float)
        if self.family == "steady":
            return np.full_like(total_strain, self.plateau)
        if self.family == "exponential":
            return self.initial * np.exp(-total_strain / self.strain) + self.plateau
        return self.initial * (1.0 + total_strain / self.strain) ** -self.exponent + self.plateau


class Relaxation(Quantity):
    """Decay of D_cyc with accumulated strain, and the state of the run at its end.

    Forms: steady D_inf; D_0 exp(-gamma/tau) and D_0 (1 + gamma/tau)^-alpha (alpha <= 5), each with and without
    a plateau D_inf, least squares in ln D. The lowest BIC = m ln(RSS/n) + k ln m wins: k parameters, n cycles,
    m = n (1 - rho)/(1 + rho) of them independent, rho the correlation of neighbouring residuals. A decay (exponential,
    power law) is named only where its best BIC is lower than that of every other family by `margin` (6: strong evidence
    in the scale of Kass & Raftery 1995), else it is "undecided"; "steady" is the name where no decay has a lower BIC.

    State, from the last half of the run: s = d ln D_cyc/d ln gamma_tot by a straight line, with error e from the
    scatter about a parabola and its correlation from cycle to cycle.
        absorbing   s + 2 e < -slope, or the mean D_cyc there is below `floor`
        diffusing   s - 2 e > -slope, and it is above `floor`
        undecided   otherwise
    slope : 0.5 by default, between a steady state (0) and the decay of activity at a critical point of conserved
    directed percolation in three dimensions (0.84). floor : D_cyc that errors of the steps alone can make; by default
    (position error)^2/(8 gamma0), from the estimate stored with the run (0 where none is).
    start : total strain from which D_cyc is fitted; by default a twentieth of the run, so that the first collapse of a
    random packing does not decide over the form of what follows (0 uses everything).
    """

    def __init__(self, margin: float = 6.0, slope: float = 0.5, floor: float | None = None, start: float | None = None):
        if not (margin >= 0.0 and slope > 0.0 and (start or 0.0) >= 0.0 and (floor or 0.0) >= 0.0):
            raise ConfigurationError("margin, floor and start must not be negative, slope must be positive")
        self.margin, self.slope, self.floor, self.start = margin, slope, floor, start

    def compute(self, run: Run) -> Self:
        """Fit D_cyc of a stored run. Raises ConfigurationError, see `CyclicDiffusivity`."""
        found = CyclicDiffusivity().compute(run)
        floor = self.floor
        if floor is None:
            error, gamma0 = position_error(run), found._gamma0
            floor = error**2 / (8.0 * gamma0) if error is not None else 0.0
        return self.fit(found.total_strain, found.d_cyc, floor)

    def fit(self, total_strain: np.ndarray, d_cyc: np.ndarray, floor: float = 0.0) -> Self:
        """Fit D_cyc (cycles,) at total_strain (cycles,); cycles without a positive finite value are left out."""
        total_strain, d_cyc = np.asarray(total_strain, float), np.asarray(d_cyc, float)
        usable = np.isfinite(d_cyc) & (d_cyc > 0.0)
        self._strain, self._values = total_strain[usable], d_cyc[usable]
        self._zero, self._still = int(np.sum(d_cyc == 0.0)), d_cyc.size > 0 and d_cyc[-1] == 0.0
        self._floor = floor
        self.__dict__.pop("fits", None)
        self._slope, self._slope_error, self._final = _late_slope(self._strain, self._values)
        return self

    @cached_property
    def fits(self) -> dict[str, DecayFit]:
        """All fitted forms by name, lowest BIC first; empty with fewer than 8 cycles. Made when first asked for."""
        end = float(self._strain[-1]) if len(self._strain) else 0.0
        late = self._strain >= (_START * end if self.start is None else self.start)
        return fit_decays(self._strain[late], self._values[late])

    @property
    def best(self) -> DecayFit | None:
        """The form of lowest BIC, whether or not the family is decided."""
        return next(iter(self.fits.values()), None)

    @property
    def family(self) -> str:
        """steady, exponential, power law or undecided."""
        if self.best is None:
            return "undecided"
        decided = self.best.family == "steady" or self.evidence >= self.margin
        return self.best.family if decided else "undecided"

    @property
    def evidence(self) -> float:
        """Difference of BIC between the best form of another family and the best form; NaN without fits."""
        if self.best is None:
            return math.nan
        return min(f.criterion for f in self.fits.values() if f.family != self.best.family) - self.best.criterion

    @property
    def relaxation_strain(self) -> float:
        """Total strain in which the decaying part of the best form falls to 1/e, dimensionless; NaN if steady."""
        return self.best.relaxation_strain if self.best else math.nan

    @property
    def late_slope(self) -> tuple[float, float]:
        """d ln D_cyc/d ln gamma_tot over the last half of the run, and its error; NaN where too few cycles."""
        return self._slope, self._slope_error

    @property
    def final(self) -> float:
        """Mean D_cyc over the last half of the run, dimensionless."""
        return 0.0 if self._still else self._final

    @property
    def state(self) -> str:
        """absorbing, diffusing or undecided, by the criterion of the class."""
        if self._still or self._final <= self._floor:
            return "absorbing"
        if not math.isfinite(self._slope_error):
            return "undecided"
        if self._slope + 2.0 * self._slope_error < -self.slope:
            return "absorbing"
        return "diffusing" if self._slope - 2.0 * self._slope_error > -self.slope else "undecided"

    @property
    def notes(self) -> list[str]:
        """What is missing or must be known."""
        notes = []
        if self.best is None:
            notes.append(f"{len(self._values)} usable cycle(s): {LEAST_CYCLES} are needed to compare decays")
        elif self.family == "power law" and self.best.relaxation_strain < self._strain[0]:
            notes.append("the power law holds from the first cycle on: its relaxation strain is not resolved")
        if self._zero:
            notes.append(f"{self._zero} cycle(s) without any displacement are left out of the fits")
        if not self._still and self._final <= self._floor:
            notes.append(
                f"D_cyc is below {self._floor:.2g}, what the estimated step errors can make: absorbing within it"
            )
        return notes

    def table(self) -> dict[str, np.ndarray]:
        """Columns total_strain, D_cyc and the best fit."""
        columns = {"total_strain[-]": self._strain, "D_cyc[-]": self._values}
        if self.best is not None:
            columns["D_cyc_fit[-]"] = self.best(self._strain)
        return columns

    def summary(self) -> dict[str, Any]:
        """State, family, relaxation strain and the numbers they rest on."""
        best = self.best
        form = {"form": best.name, "exponent": best.exponent, "D_inf": best.plateau} if best else {}
        return {
            "state": self.state,
            "late_slope": self._slope,
            "late_slope_error": self._slope_error,
            "D_cyc_last_half": self.final,
            "floor": self._floor,
            "family": self.family,
            "BIC_margin": self.evidence,
            "relaxation_strain": self.relaxation_strain,
            **form,
            "notes": self.notes,
        }

    def plot(self, ax) -> None:
        """D_cyc against total strain with the best fit."""
        ax.loglog(self._strain, self._values, ls="none", marker=".", ms=4, color="#0072B2")
        if self.best is not None:
            ax.loglog(self._strain, self.best(self._strain), color="black", lw=0.8, label=self.best.name)
            ax.legend(frameon=False)
        ax.set_xlabel(r"$\gamma_\mathrm{tot}$")
        ax.set_ylabel(r"$D_\mathrm{cyc}$")


def fit_decays(total_strain: np.ndarray, d_cyc: np.ndarray) -> dict[str, DecayFit]:
    """All forms fitted to positive D_cyc (n,) at total_strain (n,), lowest BIC first; empty for n < 8."""
    if len(d_cyc) < LEAST_CYCLES:
        return {}
    logarithms, n = np.log(d_cyc), len(d_cyc)
    fits = [_fit_shape(name, total_strain, logarithms) for name in _SHAPES]
    best = min(fits, key=lambda fit: fit.residual)
    rho = _correlation(logarithms - np.log(best(total_strain)), best.parameters)
    independent = max(n * (1.0 - rho) / (1.0 + rho), 2.0)
    if best.residual <= _EXACT:
        independent = float(n)
    scored = []
    for fit in fits:
        spread = 2.0 * math.log(max(fit.residual, _EXACT))
        score = independent * spread + fit.parameters * math.log(independent)
        scored.append(DecayFit(**(vars(fit) | {"criterion": score})))
    return {fit.name: fit for fit in sorted(scored, key=lambda fit: fit.criterion)}


def _fit_shape(name: str, strain: np.ndarray, logarithms: np.ndarray) -> DecayFit:
    family, decaying, plateau = _SHAPES[name]
    if family == "steady":
        mean = float(logarithms.mean())
        rms = float(np.sqrt(np.mean((logarithms - mean) ** 2)))
        return DecayFit(name, 0.0, math.exp(mean), math.nan, math.nan, rms)
    span, first, low = float(strain[-1]), float(logarithms[0]), float(logarithms.min())
    spacing = float(np.diff(strain).min())

    def model(p):
        if family == "exponential":
            curve = p[0] - strain * np.exp(-p[1])
        else:
            curve = p[0] - np.exp(p[2]) * np.log1p(strain * np.exp(-p[1]))
        return np.logaddexp(curve, p[-1]) if plateau else curve

    lower = [low - 5.0, math.log(spacing / 10.0), math.log(0.05)][:decaying] + [low - 3.0] * plateau
    upper = [first + 40.0, math.log(100.0 * span), math.log(_LARGEST_EXPONENT)][:decaying]
    upper += [float(logarithms.max()) + 1.0] * plateau
    best = None
    for scale in (0.02, 0.1, 0.5):
        guess = [first + 0.5, math.log(max(scale * span, spacing)), 0.0][:decaying] + [low] * plateau
        guess = np.clip(guess, np.add(lower, 1e-3), np.subtract(upper, 1e-3))
        found = least_squares(lambda p: model(p) - logarithms, guess, bounds=(lower, upper), x_scale="jac")
        best = found if best is None or found.cost < best.cost else best
    p = best.x
    exponent = math.exp(p[2]) if family == "power law" else math.nan
    rms = math.sqrt(2.0 * best.cost / len(strain))
    return DecayFit(name, math.exp(p[0]), math.exp(p[-1]) if plateau else 0.0, math.exp(p[1]), exponent, rms)


def _correlation(residuals: np.ndarray, parameters: int) -> float:
    """Correlation rho of neighbouring residuals of a fit with `parameters`, 0 <= rho < 1, noise taken as AR(1).

    rho = (n r_1 + p)/(n - 2 - p) removes the bias of short fitted series to first order (Kendall 1954).
    """
    n, power = len(residuals), float(residuals @ residuals)
    if power == 0.0 or n < parameters + 4:
        return 0.0
    neighbours = float(residuals[1:] @ residuals[:-1]) / power
    return min(max((n * neighbours + parameters) / (n - 2 - parameters), 0.0), 1.0 - 1.0 / n)


def _quadratic(vector: np.ndarray, rho: float) -> float:
    """Sum_jk v_j rho^|j-k| v_k."""
    overlap = np.correlate(vector, vector, "full")[len(vector) - 1 :]
    powers = rho ** np.arange(len(vector))
    return float(2.0 * overlap @ powers - overlap[0])


def _late_slope(strain: np.ndarray, values: np.ndarray) -> tuple[float, float, float]:
    """Slope of ln D against ln strain over the last half, its error, and the mean of D there."""
    if not len(strain):
        return math.nan, math.nan, 0.0
    late = strain > 0.5 * strain[-1]
    mean = float(values[late].mean())
    count = int(late.sum())
    if count < 4:
        return math.nan, math.nan, mean
    x, y = np.log(strain[late]), np.log(values[late])
    degree = 2 if count >= LEAST_CYCLES else 1
    basis, triangle = np.linalg.qr(np.vander(x - x.mean(), degree + 1, increasing=True))
    coefficients = basis.T @ y
    residuals = y - basis @ coefficients  # of a parabola: curvature of the decay is not noise
    rho = _correlation(residuals, degree + 1)
    freedom = count - sum(_quadratic(q, rho) for q in basis.T)  # of E[sum of squares] = sigma^2 freedom
    variance = float(residuals @ residuals) / freedom * _quadratic(basis[:, 1], rho)
    scale = float(triangle[1, 1])
    return float(coefficients[1]) / scale, math.sqrt(variance) / abs(scale), mean
