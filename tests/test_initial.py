"""Starting configurations: every file kind gives back the same scene, and every defect is named."""

from __future__ import annotations

import math
from types import SimpleNamespace

import gsd.hoomd
import h5py
import numpy as np
import pytest

from suspend.box import cell_vectors, wrap
from suspend.errors import ConfigurationError, StorageError
from suspend.initial import load_configuration, prepare_initial
from suspend.io import RunStore
from suspend.packing import random_packing
from suspend.structure import pairs_within

NUMBER, FRACTION, TILT = 12, 0.3, 0.25


def scene():
    """Positions (N,3) and edge of a small packing."""
    packing = random_packing(NUMBER, FRACTION, 0.3, seed=5)
    return packing.positions.copy(), packing.length


def write_npz(path, x, length, tilt, radius=1.0):
    np.savez(path, positions=x, L=length, tilt=tilt, radius=radius)


def write_xyz(path, x, length, tilt, radius=1.0):
    vectors = " ".join(f"{v:.17g}" for v in cell_vectors(length, tilt).ravel())
    rows = [f"A {a:.17g} {b:.17g} {c:.17g} {radius:.17g}" for a, b, c in x]
    head = f'Time=0.5 Properties=species:S:1:pos:R:3:radius:R:1 Lattice="{vectors}" pbc="T T T"'
    path.write_text("\n".join([str(len(x)), head, *rows]) + "\n")


def write_gsd(path, x, length, tilt, radius=1.0):
    frame = gsd.hoomd.Frame()
    frame.particles.N = len(x)
    frame.particles.position = x - 0.5 * cell_vectors(length, tilt).sum(axis=0)
    frame.particles.diameter = np.full(len(x), 2 * radius)
    frame.configuration.box = [length, length, length, tilt, 0, 0]
    with gsd.hoomd.open(path, "w") as file:
        file.append(frame)


def write_h5(path, x, length, tilt):
    with h5py.File(path, "w") as file:
        group = file.create_group("particles/spheres")
        group["position/value"] = np.stack([x + 0.01, x])
        group["box/edges/value"] = np.stack([cell_vectors(length, 0.0), cell_vectors(length, tilt)])


WRITERS = {"npz": write_npz, "xyz": write_xyz, "extxyz": write_xyz, "gsd": write_gsd, "h5": write_h5}


def configuration(initial, **changes):
    """The attributes of a resolved configuration that decide about a start."""
    particles = {
        "number": NUMBER,
        "volume_fraction": FRACTION,
        "radius": 1.0,
        "initial": str(initial),
        "frame": -1,
        "minimum_gap": 1e-3,
    }
    lubrication = {"enabled": True, "minimum_gap": 0.0}
    particles.update({k: v for k, v in changes.items() if k in particles})
    return SimpleNamespace(
        seed=changes.get("seed", 1),
        particles=SimpleNamespace(**particles),
        contact=changes.get("contact"),
        lubrication=SimpleNamespace(**{**lubrication, **changes.get("lubrication", {})}),
    )


@pytest.mark.parametrize("kind", WRITERS)
def test_every_kind_of_file_gives_the_scene_back(tmp_path, kind):
    """Same cell and positions as written, to round-off; GSD stores float32, 1e-7 L."""
    x, length = scene()
    path = tmp_path / f"start.{kind}"
    WRITERS[kind](path, x, length, TILT)
    loaded = load_configuration(path)
    tolerance = 2e-7 * length if kind == "gsd" else 1e-13 * length
    assert loaded.length == pytest.approx(length, rel=1e-7)
    assert loaded.tilt == pytest.approx(TILT, abs=1e-7)
    moved = (loaded.positions - x) @ np.linalg.inv(cell_vectors(length, TILT))
    assert np.max(np.abs(moved - np.rint(moved))) * length < tolerance
    expected = np.sort(pairs_within(x, length, 4.0, TILT).distance)
    np.testing.assert_allclose(
        np.sort(pairs_within(loaded.positions, loaded.length, 4.0, loaded.tilt).distance)[:60],
        expected[:60],
        atol=4 * tolerance,
    )
    assert loaded.radius == (None if kind == "h5" else pytest.approx(1.0))


@pytest.mark.parametrize("written", [0.75, -0.5, 0.5, 3.25])
def test_tilt_is_reduced_and_the_lattice_kept(tmp_path, written):
    """Tilts that differ by an integer span the same lattice, so all distances stay (round-off)."""
    x, length = scene()
    write_npz(tmp_path / "a.npz", x, length, written)
    loaded = load_configuration(tmp_path / "a.npz")
    assert -0.5 <= loaded.tilt < 0.5
    assert loaded.tilt - written == pytest.approx(round(loaded.tilt - written), abs=1e-14)
    before = np.sort(pairs_within(x, length, 3.9, written).distance)
    after = np.sort(pairs_within(loaded.positions, length, 3.9, loaded.tilt).distance)
    np.testing.assert_allclose(after, before, atol=1e-12)


def test_shift_is_the_tilt_times_the_edge(tmp_path):
    x, length = scene()
    np.savez(tmp_path / "a.npz", positions=x, L=length, shift=0.2 * length)
    assert load_configuration(tmp_path / "a.npz").tilt == pytest.approx(0.2, abs=1e-15)


def test_frames_count_from_either_end(tmp_path):
    """Frame 0 has no tilt and positions moved by 0.01, frame 1 = -1 is the last; 2 is not there."""
    x, length = scene()
    path = tmp_path / "other.h5"
    write_h5(path, x, length, TILT)
    assert load_configuration(path, 0).tilt == 0.0
    first, last = load_configuration(path, 1), load_configuration(path, -1)
    assert np.array_equal(first.positions, last.positions)
    assert last.tilt == pytest.approx(TILT, abs=1e-15)
    texts = []
    for k in range(3):
        write_xyz(tmp_path / "one.xyz", x + k, length, 0.1 * k)
        texts.append((tmp_path / "one.xyz").read_text())
    (tmp_path / "all.xyz").write_text("".join(texts))
    for frame in (0, 1, 2, -1, -2, -3):
        assert load_configuration(tmp_path / "all.xyz", frame).tilt == pytest.approx(0.1 * (frame % 3))
    for source in (path, tmp_path / "all.xyz"):
        for frame in (3, -4):
            with pytest.raises(ConfigurationError, match=r"particles.frame is -?\d, but the file holds"):
                load_configuration(source, frame)


def run_record(index, x, tilt):
    """The least a cycle's record may hold: one sample, one frame."""
    zero = np.zeros(1)
    return {
        "index": index,
        "complete": True,
        **{name: zero + index for name in ("time", "strain", "rate", "frame_time", "frame_strain")},
        "phase": zero,
        "frame_phase": zero,
        "tilt": np.array([tilt]),
        "position": x[None],
        "image": np.zeros((1, *x.shape), np.int32),
        "unwrapped": x[None],
        "statistics": {"evaluations": 1},
    }


def test_run_of_ours_gives_its_frames_and_radius(tmp_path):
    """Two cycles of a run in its own unit of length (radius 3), the second perhaps only in the journal yet:
    both frames are found from the folder, the positions bit for bit.
    """
    x, length = scene()
    text = "particles: {number: 12, volume_fraction: 0.3, radius: 3.0}"
    meta = {"number": NUMBER, "L": 3 * length}
    with RunStore.create(tmp_path / "run", text, meta) as store:
        store.append_cycle(run_record(0, 3 * (x * 0.999), 0.0))
        store.append_cycle(run_record(1, 3 * x, TILT))
        during = load_configuration(tmp_path / "run")
        store.consolidate()
    for loaded in (during, load_configuration(tmp_path / "run" / "trajectory.h5")):
        assert (loaded.length, loaded.radius) == (3 * length, 3.0)
        assert loaded.tilt == pytest.approx(TILT, abs=1e-15)
        np.testing.assert_array_equal(loaded.positions, wrap(3 * x, 3 * length, TILT))
    assert load_configuration(tmp_path / "run", 0).tilt == 0.0
    start = prepare_initial(configuration("run", frame=0), tmp_path)
    np.testing.assert_allclose(start.positions, 0.999 * x, atol=1e-13 * length)
    with pytest.raises(ConfigurationError, match="the file holds 2 frame"):
        load_configuration(tmp_path / "run", 2)


@pytest.mark.parametrize("kind", WRITERS)
def test_truncated_files_are_named(tmp_path, kind):
    """Half of any file must end in a StorageError that names it, never in a scene or a traceback."""
    path = tmp_path / f"start.{kind}"
    WRITERS[kind](path, *scene(), TILT)
    data = path.read_bytes()
    for size in (0, 3, len(data) // 2, len(data) - len(data) // 4):
        path.write_bytes(data[:size])
        with pytest.raises((StorageError, ConfigurationError), match=r"start\."):
            load_configuration(path)


def test_complete_frames_of_a_truncated_xyz_can_be_read(tmp_path):
    x, length = scene()
    path = tmp_path / "a.xyz"
    write_xyz(path, x, length, TILT)
    path.write_text(path.read_text() + "12\ncomment\nA 1 2 3\n")
    assert len(load_configuration(path, 0).positions) == NUMBER
    with pytest.raises(StorageError, match="frame 1 announces 12 spheres and holds 1"):
        load_configuration(path)


def arrays(**changes):
    x, length = scene()
    return {"positions": x, "L": length, **changes}


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        ({"positions": np.full((12, 3), np.nan)}, "12 position"),
        ({"positions": np.zeros((0, 3))}, "no spheres"),
        ({"positions": np.zeros((4, 2))}, r"shape \(4, 2\)"),
        ({"positions": np.array(["a", "b"])}, "not numbers"),
        ({"L": -3.0}, "positive edge"),
        ({"L": [1.0, 2.0]}, "one number"),
        ({"L": np.inf}, "positive edge"),
        ({"tilt": np.nan}, "not finite"),
        ({"tilt": 0.1, "shift": 0.1}, "both tilt and shift"),
        ({"radius": np.array([1.0] * 11 + [1.2])}, "only equal spheres"),
        ({"radius": 0.0}, "must be positive"),
        ({"radius": np.array([])}, r"radius has shape \(0,\)"),
        ({"radius": np.ones(5)}, r"radius has shape \(5,\)"),
        ({"tilt": 1e18}, "the tilt is 1e"),
        ({"positions": np.full((12, 3), 1e13)}, "cells away"),
    ],
)
def test_unusable_npz_says_why(tmp_path, changes, words):
    np.savez(tmp_path / "a.npz", **arrays(**changes))
    with pytest.raises(ConfigurationError, match=words):
        load_configuration(tmp_path / "a.npz")


def test_missing_things_say_what_was_expected(tmp_path):
    np.savez(tmp_path / "a.npz", x=np.zeros(3))
    with pytest.raises(ConfigurationError, match=r"no array 'positions' \(found x"):
        load_configuration(tmp_path / "a.npz")
    with pytest.raises(StorageError, match="no such file"):
        load_configuration(tmp_path / "b.npz")
    with pytest.raises(StorageError, match=r"no trajectory\.h5"):
        load_configuration(tmp_path)
    (tmp_path / "a.pdb").write_text("x")
    with pytest.raises(ConfigurationError, match=r"unknown kind of file '\.pdb'"):
        load_configuration(tmp_path / "a.pdb")
    with h5py.File(tmp_path / "a.h5", "w") as file:
        file["other"] = 1
    with pytest.raises(ConfigurationError, match="no group /particles/spheres"):
        load_configuration(tmp_path / "a.h5")


@pytest.mark.parametrize(
    ("text", "error", "words"),
    [
        ("2\nno cell\nA 0 0 0\nA 3 3 3\n", ConfigurationError, "Lattice"),
        ('1\nLattice="9 0 0 0 9 0 0 0 8"\nA 0 0 0\n', ConfigurationError, "only a cubic cell"),
        ('1\nLattice="9 0 0 0 9 0 1 0 9"\nA 0 0 0\n', ConfigurationError, "only a cubic cell"),
        ('1\nLattice="9 0 0 0 9 0 0 0 9" pbc="T T F"\nA 0 0 0\n', ConfigurationError, "fully periodic"),
        ('1\nLattice="9 0 0 0 9 0 0 0"\nA 0 0 0\n', StorageError, "Lattice has 8 numbers"),
        ('1\nLattice="9 0 0 0 9 0 0 0 9"\nA 0 zero 0\n', StorageError, "pos holds no number"),
        ('1\nLattice="9 0 0 0 9 0 0 0 9"\nA 0 0\n', StorageError, "3 columns"),
        ('1\nLattice="9 0 0 0 9 0 0 0 9" Properties=id:I:1\n1\n', ConfigurationError, "no pos:R:3"),
        ("first line\n", StorageError, "must begin with the number"),
    ],
)
def test_unusable_xyz_says_why(tmp_path, text, error, words):
    (tmp_path / "a.xyz").write_text(text)
    with pytest.raises(error, match=words):
        load_configuration(tmp_path / "a.xyz")


def test_random_start_comes_with_its_report():
    """The packing of the configuration's seed, in radii whatever particles.radius is."""
    start = prepare_initial(configuration("equilibrium", radius=2.5, seed=9))
    again = random_packing(NUMBER, FRACTION, 1e-3, 9)
    assert np.array_equal(start.positions, again.positions)
    assert start.minimum_gap == pytest.approx(again.minimum_gap)
    assert (start.length, start.tilt, start.radius) == (again.length, 0.0, 1.0)
    assert start.packing.sweeps == again.sweeps


@pytest.mark.parametrize("given", [True, False])
def test_lengths_are_divided_by_the_radius(tmp_path, given):
    """A file in metres gives the same start as one in radii, whether it states its radius or the
    configuration does (round-off).
    """
    x, length = scene()
    radius = 2.5e-6
    stated = {"radius": radius} if given else {}
    np.savez(tmp_path / "a.npz", positions=x * radius, L=length * radius, **stated)
    start = prepare_initial(configuration("a.npz", radius=1.0 if given else radius), tmp_path)
    assert start.length == pytest.approx(length, rel=1e-14)
    np.testing.assert_allclose(start.positions, x, atol=1e-13 * length)
    smallest = pairs_within(x, length, 4.0).distance.min()
    assert start.minimum_gap == pytest.approx(smallest - 2.0, abs=1e-12)
    first, second = start.closest_pair
    d = x[first] - x[second]
    assert np.linalg.norm(d - length * np.rint(d / length)) == pytest.approx(smallest)


def test_disagreement_with_the_configuration_tells_both_numbers(tmp_path):
    x, length = scene()
    write_npz(tmp_path / "a.npz", x, length, 0.0)
    with pytest.raises(ConfigurationError, match=r"holds 12 spheres, but particles.number is 13"):
        prepare_initial(configuration("a.npz", number=13), tmp_path)
    with pytest.raises(ConfigurationError, match=r"is 0\.3 .*volume_fraction is 0\.31"):
        prepare_initial(configuration("a.npz", volume_fraction=0.31), tmp_path)


@pytest.mark.parametrize(
    ("changes", "accepted"),
    [
        ({}, False),
        ({"contact": SimpleNamespace(stiffness=1e4)}, True),
        ({"lubrication": {"enabled": False}}, True),
        ({"lubrication": {"minimum_gap": 1e-3}}, True),
    ],
)
def test_overlap_is_refused_where_it_has_no_meaning(tmp_path, changes, accepted):
    """Gap -0.01 between spheres 3 and 7: refused, named and measured, unless something defines it."""
    x, length = scene()
    x[7] = x[3] + [0.0, 1.99, 0.0]
    distances = pairs_within(x, length, 2.0).distance
    write_npz(tmp_path / "a.npz", x, length, 0.0)
    config = configuration("a.npz", **changes)
    if accepted:
        assert prepare_initial(config, tmp_path).minimum_gap == pytest.approx(distances.min() - 2.0)
    else:
        with pytest.raises(ConfigurationError, match=r"counted from 0.*gap -0\.\d+ radii"):
            prepare_initial(config, tmp_path)


def test_coincident_spheres_are_refused_always(tmp_path):
    """Without a line of centres no force has a direction, contact or not."""
    x, length = scene()
    x[7] = x[3] + [length, 0.0, 0.0]
    write_npz(tmp_path / "a.npz", x, length, 0.0)
    with pytest.raises(ConfigurationError, match=r"spheres [37] and [37] .*at the same place"):
        prepare_initial(configuration("a.npz", contact=1), tmp_path)


def test_sphere_that_overlaps_its_own_image_is_refused(tmp_path):
    """One sphere at phi = 0.55 needs an edge of 1.97 radii."""
    length = (4 * math.pi / 3 / 0.55) ** (1 / 3)
    write_npz(tmp_path / "a.npz", np.zeros((1, 3)), length, 0.0)
    with pytest.raises(ConfigurationError, match="its own periodic image"):
        prepare_initial(configuration("a.npz", number=1, volume_fraction=0.55), tmp_path)


@pytest.mark.parametrize(
    "properties",
    ["species:S:1:xpos:R:3", "species:S:1:pos:R:3:radius:R:0", "species:S:1:pos:R:3:radius:S:1", "species:S:1:pos:R:³",
     "species:S:1:pos:R:3:radius:R:²", "species:S:1:pos:R:3:pos:R:3", "species:S:1:pos:S:3", "species:S:1:pos:R:03x"],
)  # fmt: skip
def test_columns_that_are_no_positions_and_radii_are_refused(tmp_path, properties):
    """Names that only contain pos, no or odd numbers of columns, names given twice: an error that shows the line."""
    x, length = scene()
    path = tmp_path / "a.xyz"
    write_xyz(path, x, length, TILT)
    count, comment, *rows = path.read_text().splitlines()
    comment = " ".join(part for part in comment.split(" ") if not part.startswith("Properties"))
    path.write_text("\n".join([count, f"{comment} Properties={properties}", *(row + " 1 1 1" for row in rows)]))
    with pytest.raises((ConfigurationError, StorageError), match="Properties="):
        load_configuration(path)


def test_number_of_spheres_is_in_plain_digits(tmp_path):
    """A superscript digit counts as a digit for Python, but not as a number."""
    (tmp_path / "a.xyz").write_text("²\ncomment\nA 1 2 3\nA 3 4 5\n")
    with pytest.raises(StorageError, match="must begin with the number of spheres"):
        load_configuration(tmp_path / "a.xyz")
