"""Fourier moduli of one oscillation cycle, and averages over one block of a steady flow.

Convention: the phase is that of the strain, theta = omega t + phi0 with gamma = gamma0 sin(theta), whatever
the initial phase phi0. A signal is Re sum_n c_n exp(i n theta), so that
    sigma_xy = gamma0 sum_n (G_n' sin n theta + omega eta_n' cos n theta): omega eta_n' - i G_n' = c_n /
    gamma0 N_k / (gamma0 omega) = nu(t) = Re sum_{n>=0} nu_n exp(i n theta):       nu_n = c_n / (gamma0
    omega).
Everything here is normalised: eta_n' and nu_n by eta0, G_n' by eta0 omega.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from suspend.conventions import COMPONENTS
from suspend.errors import ConfigurationError, NumericalError, StorageError

HARMONICS = 9
PARTS = ("hydrodynamic", "interparticle", "flow_driven")  # flow_driven is contained in hydrodynamic
_XX, _YY, _ZZ, _XY = (COMPONENTS.index(name) for name in ("xx", "yy", "zz", "xy"))
_UNIFORMITY = 1e-8  # of a cycle: how far samples may lie from equal phases
_STRAIN_MISMATCH = 1e-6  # of the amplitude, between the recorded strain and gamma0 sin(theta)


def fourier_coefficients(theta: np.ndarray, signal: np.ndarray, harmonics: int = HARMONICS) -> np.ndarray:
    """Complex coefficients c_n, n = 0..harmonics, of signal(theta) = Re sum_n c_n exp(i n theta).

    c_0 is the mean and c_n = (2/N) sum_k s_k exp(-i n theta_k), the discrete Fourier transform. theta (N,)
    in radians at N equal phases over exactly one cycle, in order, starting anywhere; signal (..., N), e.g.
    one row a cycle; returns (..., harmonics + 1). Exact for signals without harmonics of N - `harmonics` or
    above; those fold onto lower ones (aliasing). Raises ConfigurationError for fewer than 2 `harmonics` + 1
    samples, and for samples that are not equally spaced.
    """
    theta, signal = np.asarray(theta, float), np.asarray(signal, float)
    count = theta.size
    if signal.shape[-1:] != theta.shape:
        raise ValueError(f"signal of shape {signal.shape} at {theta.shape} phases")
    if count <= 2 * harmonics:
        raise ConfigurationError(
            f"{count} samples in a cycle are too few for harmonic {harmonics}: set output.samples_per_cycle "
            f"to {2 * harmonics + 1} or more (64 by default)"
        )
    step = np.diff(theta, append=theta[0]) - 2.0 * np.pi / count
    uneven = np.abs(np.angle(np.exp(1j * step))).max() / (2.0 * np.pi)
    if uneven > _UNIFORMITY:
        raise ConfigurationError(
            f"the {count} samples are not at equal phases of one cycle (off by {uneven:.2g} of a cycle): the "
            "discrete Fourier transform needs equal spacing over one complete cycle"
        )
    basis = np.exp(-1j * np.outer(theta, np.arange(harmonics + 1))) * (2.0 / count)
    basis[:, 0] *= 0.5
    return signal @ basis


@dataclass(frozen=True)
class PartModuli:
    """Moduli of one part of the stress, index n = 0..9 (index 0 of `viscous`: the cycle mean of sigma_xy).

    viscous: eta_n'/eta0; elastic: G_n'/(eta0 omega); n1, n2: nu_n/eta0 of N1 and N2, complex. Each (10,).
    """

    viscous: np.ndarray
    elastic: np.ndarray
    n1: np.ndarray
    n2: np.ndarray


@dataclass(frozen=True)
class CycleModuli:
    """Moduli of one cycle: total = fluid + hydrodynamic + interparticle.

    The fluid's own stress 2 eta0 E (1 in eta_1'/eta0, nothing elsewhere) is in `total` only; `flow_driven`,
    the share of `hydrodynamic` that the flow alone drives, is None where it was not stored.
    """

    total: PartModuli
    hydrodynamic: PartModuli
    interparticle: PartModuli
    flow_driven: PartModuli | None = None

    @property
    def eta_r_prime(self) -> float:
        """eta_r' = eta_1'/eta0, the relative viscosity."""
        return float(self.total.viscous[1])

    @property
    def eta_r_double_prime(self) -> float:
        """eta_r'' = G_1'/(eta0 omega), the relative elastic response."""
        return float(self.total.elastic[1])

    @property
    def thinning(self) -> float:
        """-eta_3'/eta_1', positive for shear thinning within the cycle; NaN without viscosity."""
        return -_ratio(self.total.viscous[3], self.total.viscous[1])

    @property
    def fifth(self) -> float:
        """eta_5'/eta_1'; NaN without viscosity."""
        return _ratio(self.total.viscous[5], self.total.viscous[1])


def cycle_theta(record: Mapping, scales: Mapping) -> np.ndarray:
    """Phase of the strain, theta = 2 pi (fraction of the cycle) + phi0, shape (n,).

    Raises StorageError where the recorded strain is not gamma0 sin(theta).
    """
    theta = 2.0 * np.pi * np.asarray(record["phase"], float) + scales["phase"]
    off = np.abs(np.asarray(record["strain"]) - scales["gamma0"] * np.sin(theta)).max(initial=0.0)
    if not off <= _STRAIN_MISMATCH * scales["gamma0"]:
        raise StorageError(
            f"cycle {record['index']}: the recorded strain is not gamma0 sin(omega t + phase) with gamma0 = "
            f"{scales['gamma0']:g}, phase = {scales['phase']:g} (off by {off:.3g}): the file does not belong "
            "to this configuration, or is damaged"
        )
    return theta


def cycle_moduli(record: Mapping, scales: Mapping) -> CycleModuli:
    """Fourier moduli of one complete cycle of oscillatory shear (equations in the module's docstring).

    `record` is a cycle as the simulation hands it out: strain (n,), phase (n,), stress_NAME (n, 6) in the
    units of the configuration. `scales` has gamma0, omega, viscosity, phase (phi0, radians). Raises
    ConfigurationError (too few samples, unequal phases), StorageError (strain does not fit), NumericalError
    (stress not finite).
    """
    parts = stress_parts(record)
    signals = np.stack([stress_signals(stress) for stress in parts.values()])  # (parts, 3, n)
    theta = cycle_theta(record, scales)
    unit = scales["viscosity"] * scales["gamma0"] * scales["omega"]
    coefficients = fourier_coefficients(theta, signals) / unit
    moduli = (PartModuli(c[0].real, -c[0].imag, c[1], c[2]) for c in coefficients)
    return CycleModuli(**dict(zip(parts, moduli, strict=True)))


def stress_parts(record: Mapping) -> dict[str, np.ndarray]:
    """The stresses (n, 6) of a record: total, hydrodynamic, interparticle, and flow_driven where stored.

    Raises NumericalError where one is not finite.
    """
    stored = [name for name in PARTS if record.get("stress_" + name) is not None]
    parts = {name: np.asarray(record["stress_" + name]) for name in stored}
    total = np.asarray(record["stress_fluid"]) + parts["hydrodynamic"] + parts["interparticle"]
    if not np.isfinite(total).all():
        raise NumericalError(f"the stress of cycle {record['index']} is not finite: the run ends there")
    return {"total": total, **parts}


def normalised_signals(record: Mapping, scales: Mapping) -> dict[str, np.ndarray]:
    """Waveforms of one cycle for Lissajous curves: strain, rate, shear, N1 and N2 (total stress), each (n,).

    strain is gamma/gamma0, rate gdot/(gamma0 omega), stresses are divided by eta0 gamma0 omega. For flows
    without oscillation strain stays as it is and rate and stresses are normalised by the reference rate.
    """
    amplitude = scales.get("gamma0", 1.0)
    reference = amplitude * scales["omega"] if "omega" in scales else abs(scales["rate"])
    shear, n1, n2 = stress_signals(stress_parts(record)["total"]) / (scales["viscosity"] * reference)
    strain, rate = np.asarray(record["strain"]) / amplitude, np.asarray(record["rate"]) / reference
    return {"strain": strain, "rate": rate, "shear": shear, "N1": n1, "N2": n2}


def stress_signals(stress: np.ndarray) -> np.ndarray:
    """sigma_xy, N1, N2 as rows (3, n)."""
    n1, n2 = stress[:, _XX] - stress[:, _YY], stress[:, _YY] - stress[:, _ZZ]
    return np.stack([stress[:, _XY], n1, n2])


def _ratio(numerator: float, denominator: float) -> float:
    return float(numerator / denominator) + 0.0 if denominator != 0.0 else float("nan")  # + 0.0: no "-0"


def cycle_row(record: Mapping, scales: Mapping, d_cyc: float | None = None) -> dict[str, float]:
    """One line of moduli.csv: header "quantity[unit]" -> value, in the order of the columns.

    total_strain = 4 gamma0 n_cyc is that at the cycle's end; the cycle's number is left to the table's
    writer. eta_n' are in units of eta0, G_n' in units of eta0 omega, nu_n in units of eta0: all
    dimensionless. Names that end in _hydrodynamic, _interparticle, _flow_driven are parts; the fluid's own 1
    is in the total only. D_cyc needs the displacement over the cycle: `d_cyc`, or else "d_cyc" among the
    record's statistics, or else NaN. Errors: see `cycle_moduli`.
    """
    moduli = cycle_moduli(record, scales)
    if d_cyc is None:
        d_cyc = record.get("statistics", {}).get("d_cyc", float("nan"))
    row = {
        "total_strain[-]": 4.0 * scales["gamma0"] * (int(record["index"]) + 1),
        "eta_r_prime[-]": moduli.eta_r_prime,
        "eta_r_double_prime[-]": moduli.eta_r_double_prime,
        "minus_eta3_over_eta1[-]": moduli.thinning,
        "eta5_over_eta1[-]": moduli.fifth,
        "D_cyc[-]": d_cyc,
    }
    orders = range(1, HARMONICS + 1)
    row |= {f"eta{n}_prime[eta0]": moduli.total.viscous[n] for n in orders}
    row |= {f"G{n}_prime[eta0*omega]": moduli.total.elastic[n] for n in orders}
    row |= _normal_stress_columns(moduli.total)
    for name in PARTS:
        part = getattr(moduli, name)
        if part is not None:
            row |= _part_columns(part, name)
    return {name: float(value) for name, value in row.items()}


def _normal_stress_columns(part: PartModuli) -> dict[str, float]:
    columns = {}
    for name, nu in (("N1", part.n1), ("N2", part.n2)):
        columns[f"{name}_nu0[eta0]"] = nu[0].real
        for n in (2, 4):
            columns[f"{name}_nu{n}_re[eta0]"] = nu[n].real
            columns[f"{name}_nu{n}_im[eta0]"] = nu[n].imag
            columns[f"{name}_nu{n}_abs[eta0]"] = abs(nu[n])
    return columns


def _part_columns(part: PartModuli, name: str) -> dict[str, float]:
    return {
        f"eta1_prime_{name}[eta0]": part.viscous[1],
        f"eta3_prime_{name}[eta0]": part.viscous[3],
        f"G1_prime_{name}[eta0*omega]": part.elastic[1],
        f"N1_nu0_{name}[eta0]": part.n1[0].real,
        f"N2_nu0_{name}[eta0]": part.n2[0].real,
        f"N2_nu2_abs_{name}[eta0]": abs(part.n2[2]),
        f"N2_nu4_abs_{name}[eta0]": abs(part.n2[4]),
    }


def block_row(record: Mapping, scales: Mapping) -> dict[str, float]:
    """One line of viscosity.csv: averages over one output block of steady, reversed or no shear.

    eta_r = <sigma_xy>/(eta0 <gdot>), with the rate's sign, so that it is positive before and after a
    reversal; NaN where the fluid is quiescent. sigma_xy, N1, N2 are in units of eta0 times `scales["rate"]`
    (shear or reference rate), shear_rate in units of the latter. total_strain is that at the block's end
    (quiescent: time x rate). `scales` has rate and viscosity. The rate is constant within a block and
    samples are at equal times, so the averages are plain means. Raises ConfigurationError for fewer than 2
    samples, NumericalError.
    """
    time, rate = np.asarray(record["time"], float), np.asarray(record["rate"], float)
    if time.size < 2:
        raise ConfigurationError(
            f"{time.size} sample(s) in a block are too few for an average: raise output.samples_per_cycle"
        )
    end = time[0] + (time[1] - time[0]) * time.size
    unit = scales["viscosity"] * abs(scales["rate"])
    mean_rate = rate.mean() / abs(scales["rate"])
    row = {"total_strain[-]": float(end * abs(scales["rate"])), "shear_rate[rate]": float(mean_rate)}
    parts = stress_parts(record)
    for name, stress in parts.items():
        tail = "" if name == "total" else "_" + name
        shear, n1, n2 = (float(value) for value in stress_signals(stress).mean(axis=1) / unit)
        row["eta_r" + tail + "[-]"] = _ratio(shear, mean_rate)
        row["sigma_xy" + tail + "[eta0*rate]"] = shear
        row["N1" + tail + "[eta0*rate]"] = n1
        row["N2" + tail + "[eta0*rate]"] = n2
    return row
