"""The configuration: what is accepted, what is refused and how, and that its files follow the schema."""

import dataclasses
import math
import os
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
import yaml

from suspend.config import Config, from_dict, load, loads
from suspend.config.keys import keys_of, sections_of
from suspend.config.reference import reference, starting_point
from suspend.config.schema import every_key
from suspend.errors import ConfigurationError, StorageError

CONFIGS = Path(__file__).parent.parent / "configs"
BASE = {
    "particles": {"number": 100, "volume_fraction": 0.4},
    "flow": {"type": "oscillatory", "amplitude": 0.8},
    "duration": {"cycles": 6},
}
TEXT = """particles:
  number: 100
  volume_fraction: 0.4
flow:
  type: oscillatory
  amplitude: 0.8
duration:
  cycles: 6
"""


def complaint(*overrides, text=TEXT):
    """The message with which `text` and overrides are refused."""
    with pytest.raises(ConfigurationError) as caught:
        loads(text, source="a.yaml", overrides=overrides)
    return str(caught.value)


def test_defaults_are_those_of_the_schema():
    """Every key that is not given and applies has the schema's default; terms not given are off."""
    config = loads(TEXT)
    for name, part in sections_of(Config).items():
        if part.optional:
            assert getattr(config, name) is None
            continue
        for inner, key in keys_of(part.cls).items():
            follows = (name, inner) in (("integrator", "tolerance"), ("solver", "tolerance"))
            if inner not in BASE.get(name, {}) and key.only is None and key.group is None and not follows:
                assert getattr(getattr(config, name), inner) == key.default
    assert (config.seed, config.far_field) == (1, "self")
    assert config.flow.omega == 1.0
    assert config.flow.rate is None and config.particles.frame is None


def test_objects_are_frozen():
    with pytest.raises(dataclasses.FrozenInstanceError):
        loads(TEXT).flow.amplitude = 2.0


@pytest.mark.parametrize(
    ("written", "value"),
    [
        ("1e-3", 1e-3),
        ("1E-3", 1e-3),
        ("1_000.5e-6", 1000.5e-6),
        ("0.001", 1e-3),
        (".001", 1e-3),
        ("1.e-3", 1e-3),
    ],
)
def test_numbers_as_people_write_them(written, value):
    """A YAML 1.1 parser takes 1e-3 (no point) for text; here it is the number."""
    assert loads(TEXT, overrides=[f"integrator.tolerance={written}"]).integrator.tolerance == value
    text = TEXT + f"integrator:\n  tolerance: {written}\n"
    assert loads(text).integrator.tolerance == value


@pytest.mark.parametrize(("written", "value"), [("1_000", 1000), ("010", 10), ("+7", 7)])
def test_integers_as_people_write_them(written, value):
    """Digits are decimal, whatever YAML 1.1 makes of a leading zero."""
    assert loads(TEXT, overrides=[f"particles.number={written}"]).particles.number == value


@pytest.mark.parametrize(
    "written",
    [
        "nan",
        ".nan",
        "inf",
        "-.inf",
        "1e999",
        "true",
        "'0.3'",
        "1d-1",
        "0x1",
        "1:30",
        "[0.3]",
        "{a: 1}",
        "",
        "９",
    ],
)
def test_what_is_no_finite_number(written):
    message = complaint(f"particles.volume_fraction={written}")
    assert message.startswith("--set: particles.volume_fraction: found ")
    assert "must be a number > 0 and <= 0.7404805" in message


@pytest.mark.parametrize(
    "override", ["repulsion.force=true", "lubrication.minimum_gap=nan", "external.force=[0, 0, no]"]
)
def test_switches_and_nan_are_no_numbers_whatever_the_range(override):
    """True is 1 and nan compares false in Python: neither must slip through a range that would hold it."""
    assert f"{override.partition('=')[0]}: found" in complaint(override)


def test_infinity_is_refused_where_there_is_no_upper_limit():
    assert every_key()["integrator.min_step"].most is None
    message = complaint("integrator.min_step=1e999", "integrator.max_step=10")
    assert "integrator.min_step: found 1e999; must be a number > 0 [strain]; it is not finite" in message


def test_minus_zero_is_zero():
    """-0.0 == 0.0, so that equal configurations must have equal texts."""
    config = loads(TEXT, overrides=["external.force=[-0.0, 0, -0]"])
    assert "force: [0.0, 0.0, 0.0]" in config.to_yaml()


@pytest.mark.parametrize("written", ["1.5", "100.0", "1e2", "true", "'3'", "0", "-4", "99999999999999999999"])
def test_what_is_no_integer_in_range(written):
    assert "particles.number: found" in complaint(f"particles.number={written}")


def test_an_integer_written_as_a_float_is_told_how_to_write_it():
    assert complaint("particles.number=1e2").endswith("write 100")


@pytest.mark.parametrize(
    ("phi", "fits"), [("0.60", True), ("0.61", False), ("0.7404", False), ("0.75", False), ("0", False)]
)
def test_volume_fraction_of_random_packings(phi, fits):
    """Random configurations are made up to 0.60, with a gap that leaves them below random close packing."""
    if fits:
        assert loads(TEXT, overrides=[f"particles.volume_fraction={phi}"]).particles.volume_fraction == float(
            phi
        )
    else:
        assert "particles.volume_fraction: found" in complaint(f"particles.volume_fraction={phi}")


@pytest.mark.parametrize(("written", "kind"), [("equilibrium", "equilibrium"), ("quenched", "quenched")])
def test_kinds_of_start(written, kind):
    """Both kinds of packing have a minimum gap, a largest volume fraction, and no frame; the default is the fluid."""
    chosen = f"particles.initial={written}"
    particles = loads(TEXT, overrides=[chosen, "particles.minimum_gap=0.01"]).particles
    assert (particles.initial, particles.minimum_gap, particles.frame) == (kind, 0.01, None)
    assert "particles.volume_fraction: found" in complaint(chosen, "particles.volume_fraction=0.61")
    assert "particles.frame: does not belong here" in complaint(chosen, "particles.frame=3")
    assert loads(TEXT).particles.initial == "equilibrium"


def test_old_name_of_the_fluid_is_read():
    """`random`, as older files and stored runs have it, is the equilibrium packing: equal configurations, one name."""
    old = loads(TEXT, overrides=["particles.initial=random"])
    assert old.particles.initial == "equilibrium"
    assert old.to_yaml() == loads(TEXT).to_yaml()


@pytest.mark.parametrize(
    ("written", "meant"),
    [
        ("randm", "equilibrium or quenched"),
        ("Random", "equilibrium or quenched"),
        ("equilibrum", "equilibrium"),
        ("Quench", "quenched"),
    ],
)
def test_misspelt_starts(written, meant):
    """A word near one of the names is no folder unless it is written as one."""
    assert f"found '{written}'; did you mean {meant}? (A folder: ./{written})" in complaint(
        f"particles.initial={written}"
    )


def test_volume_fraction_of_files_goes_to_close_packing():
    """Equal spheres fill pi/sqrt(18) of space at most."""
    text = ["particles.initial=fcc.xyz", "particles.volume_fraction=0.7404"]
    assert loads(TEXT, overrides=text).particles.volume_fraction == 0.7404
    assert math.isclose(every_key()["particles.volume_fraction"].most, math.pi / math.sqrt(18))
    assert "<= 0.7404805" in complaint("particles.initial=fcc.xyz", "particles.volume_fraction=0.7405")


def test_all_errors_at_once_with_file_and_line():
    text = (
        TEXT.replace("number: 100", "numbr: 100").replace("0.8", "-1")
        + "repulsion:\n  force: strong\ncolour: 3\n"
    )
    lines = complaint("solver.tolerance=2", text=text).splitlines()
    assert lines[0] == "6 errors in the configuration a.yaml"
    assert [line.strip() for line in lines[1:]] == [
        "a.yaml:11: colour: unknown key; there are seed, tolerance, far_field, particles, fluid, flow,"
        " duration, ewald, lubrication, repulsion, contact, external, integrator, solver, output",
        "a.yaml:2: particles.numbr: unknown key; did you mean number?",
        "a.yaml:1: particles.number: is missing; must be an integer >= 1 and <= 10000000"
        " (number of spheres N)",
        "a.yaml:6: flow.amplitude: found -1; must be a number >= 1e-08 and <= 10000 [strain]",
        "a.yaml:10: repulsion.force: found 'strong'; must be a number >= 0 and <= 1e+12 [F_stk]",
        "--set: solver.tolerance: found 2; must be a number >= 1e-14 and <= 0.1 or null",
    ]


@pytest.mark.parametrize(
    ("override", "suggestion"),
    [
        ("flow.amplitud=1", "amplitude"),
        ("flow.Amplitude=1", "amplitude"),
        ("flow.gamma0=1", "flow.amplitude"),
        ("phi=0.3", "particles.volume_fraction"),
        ("amplitude=1", "flow.amplitude"),
        ("sead=1", "seed"),
        ("solvr.tolerance=1", "solver.tolerance"),
        ("particles.omega=1", "flow.omega"),
        ("integrator.dt=1", "integrator.step"),
        ("output.samples-per-cycle=32", "samples_per_cycle"),
    ],
)
def test_unknown_keys_get_a_suggestion(override, suggestion):
    message = complaint(override)
    assert "unknown key; did you mean" in message
    assert suggestion in message.partition("did you mean")[2].rstrip("?").replace(" or ", " ").split()


def test_choices_get_a_suggestion():
    message = complaint("flow.type=Oscillatory")
    assert (
        "found 'Oscillatory'; must be oscillatory | steady | reversal | quiescent; did you mean oscillatory?"
        in message
    )


def test_duplicate_keys():
    message = complaint(text=TEXT + "  cycles: 7\nflow: {}\n")
    assert "a.yaml:9: cycles: this key is given twice (first in line 8); keep one of them" in message
    assert "a.yaml:10: flow: this key is given twice (first in line 4)" in message


@pytest.mark.parametrize(
    ("section", "first", "second"), [("flow", "omega", "frequency"), ("duration", "cycles", "strain")]
)
def test_exclusive_keys(section, first, second):
    data = {name: dict(part) for name, part in BASE.items()}
    data[section] |= {first: 1, second: 2}
    with pytest.raises(
        ConfigurationError, match=rf"{first} and {second} exclude each other, found {first}: 1, {second}: 2"
    ):
        from_dict(data)


def test_frequency_is_cycles_per_time():
    """omega = 2 pi frequency; the resolved configuration holds omega alone."""
    config = loads(TEXT, overrides=["flow.frequency=2"])
    assert config.flow.omega == 4.0 * math.pi
    assert config.flow.frequency is None
    assert loads(config.to_yaml()) == config


def test_an_override_replaces_the_other_key_of_an_exclusive_pair():
    config = loads(TEXT, overrides=["duration.strain=3", "flow.frequency=1"])
    assert (config.duration.strain, config.duration.cycles) == (3.0, None)
    assert "exclude each other" in complaint("duration.strain=3", "duration.cycles=3")


def test_overrides():
    config = loads(TEXT, overrides=["repulsion.force=3", "external={force: [0, 0, -1]}", "seed=4", "seed=5"])
    assert (config.repulsion.force, config.repulsion.debye_length, config.seed) == (3.0, 0.01, 5)
    assert config.external.force == (0.0, 0.0, -1.0) and config.external.torque == (0.0, 0.0, 0.0)
    assert loads(config.to_yaml(), overrides=["repulsion=null"]).repulsion is None
    for wrong in ("seed", "=3", "seed:3"):
        assert "must be key=value" in complaint(wrong)
    assert "--set: seed: found '[1'" in complaint("seed=[1")


@pytest.mark.parametrize(
    ("overrides", "key"),
    [
        (["flow.rate=1"], "flow.rate"),
        (["flow.reversal_strain=1"], "flow.reversal_strain"),
        (["flow.type=steady", "duration.strain=1"], "flow.amplitude"),
        (["flow.type=steady", "flow.amplitude=null", "flow.phase=0", "duration.strain=1"], "flow.phase"),
        (["particles.frame=0"], "particles.frame"),
        (["particles.initial=a.xyz", "particles.minimum_gap=0.1"], "particles.minimum_gap"),
        (["ewald={}"], "ewald"),
        (["ewald.tolerance=1e-4"], "ewald"),
        (["far_field=identity", "ewald.split=pswf"], "ewald"),
        (["solver.far_tolerance=1e-4"], "solver.far_tolerance"),
    ],
)
def test_keys_that_do_not_belong(overrides, key):
    message = complaint(*overrides)
    assert f"{key}: does not belong here" in message and "errors" not in message


@pytest.mark.parametrize(
    ("overrides", "key"),
    [
        (["contact.stiffness=1e4"], "contact"),
        (["lubrication.minimum_gap=2"], "lubrication.minimum_gap"),
        (["lubrication.cutoff=2"], "lubrication.cutoff"),
        (["far_field=ewld"], "far_field"),
        (["far_field=ewald", "ewald.tolerance=1e-11"], "ewald.tolerance"),
        (["far_field=ewald", "ewald.grid=[16, 16]"], "ewald.grid"),
        (["far_field=ewald", "ewald.grid=[16, 16, 16.0]"], "ewald.grid"),
        (["far_field=ewald", "ewald.grid=[16, 16, 6]", "ewald.support=8"], "ewald.grid"),
        (["far_field=ewald", "particles.number=1", "particles.volume_fraction=0.55"], "particles.number"),
        (["far_field=ewald", "solver.far_tolerance=1e-2", "integrator.tolerance=1e-4"], "solver.far_tolerance"),
        (["far_field=ewald", "integrator.tolerance=1e-5", "ewald.tolerance=1e-3"], "ewald.tolerance"),
        (["tolerance=0.1"], "tolerance"),
        (["integrator.method=rk2"], "integrator.step"),
        (["integrator.min_step=0.2"], "integrator.min_step"),
        (["output.samples_per_cycle=18"], "output.samples_per_cycle"),
        (["output.position_phases=[0.5]"], "output.position_phases"),
        (["output.position_phases=[0, 0.5, 0.5]"], "output.position_phases"),
        (["output.position_phases=[0, 1]"], "output.position_phases"),
        (["output.position_phases=[]"], "output.position_phases"),
        (["external.force=[1, 2]"], "external.force"),
        (["particles.initial=randm"], "particles.initial"),
        (["particles.volume_fraction=0.6", "particles.minimum_gap=0.1"], "particles.minimum_gap"),
        (["flow.phase=90"], "flow.phase"),
        (["flow.omega=1e30", "flow.amplitude=100"], "flow.amplitude"),
        (["contact={gap_shift: 0.1}"], "contact.stiffness"),
        (["repulsion=true"], "repulsion"),
        (["repulsion.debye_length=0"], "repulsion.debye_length"),
        (["lubrication.enabled=1"], "lubrication.enabled"),
        (["seed=-1"], "seed"),
        (["flow=null"], "flow.type"),
        (["particles.radius=null"], "particles.radius"),
    ],
)
def test_impossible_combinations_and_values(overrides, key):
    assert f": {key}: " in complaint(*overrides)


@pytest.mark.parametrize(
    ("overrides", "expected"),
    [
        ([], (1e-3, 1e-5, 1e-3, 1e-3)),
        (["tolerance=1e-4"], (1e-4, 1e-6, 1e-4, 1e-4)),
        (["tolerance=1e-4", "integrator.tolerance=2e-3"], (2e-3, 1e-6, 1e-4, 1e-4)),
        (["integrator.tolerance=1e-6"], (1e-6, 1e-5, 1e-6, 1e-6)),
        (["integrator.tolerance=1e-12"], (1e-12, 1e-5, 1e-12, 1e-10)),
        (["solver.tolerance=3e-6", "ewald.tolerance=1e-5"], (1e-3, 3e-6, 1e-3, 1e-5)),
        (["solver.far_tolerance=1e-6", "ewald.tolerance=null"], (1e-3, 1e-5, 1e-6, 1e-3)),
    ],
)
def test_tolerances_follow_from_the_one_of_the_run(overrides, expected):
    """Integrator, near-field solve, coupled solve, Ewald sum: 1, 1/100, 1, 1 times the run's, unless given.

    Those of the far field are not above the integrator's, whose error estimate they would drown.
    """
    config = loads(TEXT, overrides=["far_field=ewald", *overrides])
    found = (
        config.integrator.tolerance, config.solver.tolerance, config.solver.far_tolerance, config.ewald.tolerance,
    )  # fmt: skip
    assert found == pytest.approx(expected, rel=1e-15)
    assert loads(config.to_yaml()) == config and from_dict(config.to_dict()) == config


def test_the_far_field_has_its_section_where_it_is_on_only():
    """far_field: ewald needs no section; without it nothing of the section is in the configuration."""
    config = loads(TEXT, overrides=["far_field=ewald", "ewald.grid=[24, 28, 24]", "ewald.support=6"])
    assert config.ewald.grid == (24, 28, 24) and config.ewald.split is config.ewald.cutoff is None
    assert loads(config.to_yaml()) == config
    off = loads(TEXT, overrides=["ewald=null", "solver.far_tolerance=null"])
    assert off == loads(TEXT) and off.ewald is None and "far_tolerance" not in off.to_yaml()
    assert "far_field is self, must be ewald; remove it" in complaint("ewald.grid=[8, 8, 8]")


def test_contact_that_can_act_is_accepted():
    """Where lubrication is frozen, or contact begins at a positive gap, the spring is reached."""
    for more in ("lubrication.minimum_gap=1e-3", "contact.gap_shift=1e-3", "lubrication.enabled=false"):
        assert loads(TEXT, overrides=["contact.stiffness=1e4", more]).contact.stiffness == 1e4


def test_duration_of_flows_without_cycles():
    steady = TEXT.replace("oscillatory\n  amplitude: 0.8", "steady")
    assert "a.yaml:7: duration.cycles: flow.type is steady: give duration.strain" in complaint(text=steady)
    assert "one key is missing: duration.cycles (an integer >= 1" in complaint("duration={}", text=steady)
    reversal = complaint("flow.type=reversal", "flow.reversal_strain=5", "duration.strain=5", text=steady)
    assert "flow.reversal_strain: found 5; must be below duration.strain, 5" in reversal


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("", "a.yaml: is empty"),
        ("# nothing\n\n", "a.yaml: is empty"),
        ("null\n", "a.yaml:1: found nothing"),
        ("- a\n- b\n", "a.yaml:1: found a list of 2"),
        ("just text", "a.yaml:1: found 'just text'"),
        ("flow:\n\ttype: steady\n", "a.yaml:2: a tab is used"),
        ("flow: [1\nseed: 1\n", "a.yaml:2: this is not valid YAML"),
        ("flow: {a: &x 1, b: *y}\n", "a.yaml:1: this is not valid YAML"),
        (TEXT + "---\n" + TEXT, "a.yaml:9: a second YAML document"),
        ("\x00\x01", "a.yaml: this is no text file"),
        ("[" * 5000, "a.yaml"),
        ("flow: &a {type: *a}\n", "nested too deeply"),
        (
            "seed: !!python/object/apply:os.system [ls]\n",
            "tag !!python/object/apply:os.system is not allowed",
        ),
        ("? [a]\n: 1\n", "a.yaml:1: a key must be a plain word"),
    ],
)
def test_what_is_no_configuration_at_all(text, message):
    assert message in complaint(text=text)


def test_switches_as_people_write_them():
    for word, value in {"off": False, "No": False, "FALSE": False, "on": True, "Yes": True}.items():
        assert loads(TEXT, overrides=[f"lubrication.enabled={word}"]).lubrication.enabled is value
    assert loads(TEXT + "repulsion: off\n").repulsion is None


def test_files_that_cannot_be_read(tmp_path):
    with pytest.raises(ConfigurationError, match=r"no such file; `suspend init"):
        load(tmp_path / "missing.yaml")
    with pytest.raises(ConfigurationError, match="is a folder"):
        load(tmp_path)
    binary = tmp_path / "binary.yaml"
    binary.write_bytes(b"seed: 1\nflow: \xff\xfe")
    with pytest.raises(ConfigurationError, match=r"binary\.yaml:2: this is no UTF-8 text"):
        load(binary)
    binary.write_bytes(b" " * (1 << 21))
    with pytest.raises(ConfigurationError, match="larger than"):
        load(binary)
    with pytest.raises(StorageError, match="cannot be read: Not a directory"):
        load(binary / "a.yaml")


def test_a_byte_order_mark_and_windows_line_ends_are_no_matter(tmp_path):
    path = tmp_path / "a.yaml"
    path.write_bytes(b"\xef\xbb\xbf" + TEXT.replace("\n", "\r\n").encode())
    assert load(path) == loads(TEXT)
    assert load(path).directory == str(tmp_path)


def test_from_dict_takes_numpy_and_refuses_what_is_no_configuration():
    data = {name: dict(part) for name, part in BASE.items()}
    data["particles"]["number"] = np.int64(100)
    data["flow"]["amplitude"] = np.float64(0.8)
    data["external"] = {"force": np.array([0.0, 0.0, -1.0])}
    config = from_dict(data)
    assert type(config.particles.number) is int and config.external.force == (0.0, 0.0, -1.0)
    with pytest.raises(ConfigurationError, match="a mapping is needed"):
        from_dict([1])
    data["flow"]["amplitude"] = object()
    with pytest.raises(ConfigurationError, match=r"<dict>: flow\.amplitude: found <object"):
        from_dict(data)


SWEEPS = ("phase_diagram.yaml",)  # files of `suspend sweep`


@pytest.mark.parametrize(
    "path", sorted(p for p in CONFIGS.glob("*.yaml") if p.name not in SWEEPS), ids=lambda path: path.name
)
def test_configurations_of_the_repository(path):
    """Each is valid, and its resolved form is the same to this parser and to PyYAML's."""
    config = load(path)
    assert loads(config.to_yaml()) == config
    assert from_dict(config.to_dict()) == config
    assert from_dict(yaml.safe_load(config.to_yaml())) == config


@pytest.mark.parametrize("seed", range(20))
def test_round_trip_of_random_numbers(seed):
    """Seventeen digits identify a double: what is written is read back bit for bit."""
    random = np.random.default_rng(seed)
    overrides = [
        f"flow.omega={10.0 ** random.uniform(-29, 29)!r}",
        f"repulsion.debye_length={10.0 ** random.uniform(-8, 1)!r}",
        f"external.force={[float(x) for x in random.normal(size=3) * 1e-9]}",
        f"seed={random.integers(2**62)}",
        "particles.initial=" + ["'no: # \"1e3\"'", "'12'", "'true'", "ü.xyz", "a b.npz"][seed % 5],
    ]
    config = loads(TEXT, overrides=overrides)
    assert loads(config.to_yaml()) == config
    assert from_dict(yaml.safe_load(config.to_yaml())) == config


def test_reference_is_in_step_with_the_schema():
    """configs/reference.yaml is what `python -m suspend.config.reference` prints, and holds every key."""
    command = [sys.executable, "-m", "suspend.config.reference"]
    printed = subprocess.run(command, capture_output=True, text=True, check=True)
    assert printed.stderr == ""
    assert (CONFIGS / "reference.yaml").read_text() == printed.stdout == reference()


@pytest.mark.parametrize("text", [reference(), starting_point()], ids=["reference", "init"])
def test_every_key_stands_in_the_reference_with_unit_default_and_meaning(text):
    words = " ".join(text.replace("#", " ").split())
    for dotted, key in every_key().items():
        assert f" {dotted.rpartition('.')[2]}: " in words
        assert " ".join(key.meaning.split()) in words
        assert not key.unit or f"[{key.unit}]" in words
    for name in sections_of(Config):
        assert f"{name}:" in text


def test_keys_in_comments_of_the_reference_are_right_when_uncommented():
    """Optional terms switched on by removing '# ' have the defaults of the schema."""
    lines, on = [], False
    for line in reference().splitlines():
        on = line.startswith(("# repulsion:", "# external:", "# ewald:")) or (on and line.startswith("#   "))
        lines.append(line[2:] if on else line)
    config = loads("\n".join(lines), overrides=["far_field=ewald"])
    assert config.ewald == loads(TEXT, overrides=["far_field=ewald"]).ewald
    assert config.repulsion == loads(TEXT, overrides=["repulsion={}"]).repulsion
    assert config.external == loads(TEXT, overrides=["external={}"]).external


def test_importing_the_configuration_does_not_import_the_physics():
    code = "import sys, suspend.config; print(sorted({'numpy', 'numba', 'scipy', 'h5py'} & set(sys.modules)))"
    printed = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert printed.stdout.strip() == "[]"


@pytest.mark.parametrize("fraction", ["1e-300", "1e-30"])
def test_cells_beyond_double_precision_are_refused(fraction):
    """A cell in which rounding moves spheres by more than gaps: one line that names the key and what is allowed."""
    text = f"particles: {{number: 3, volume_fraction: {fraction}}}\n"
    text += "flow: {type: oscillatory, amplitude: 1.0}\nduration: {cycles: 1}\n"
    with pytest.raises(ConfigurationError, match=r"particles\.volume_fraction: found 1e-\d+; must be >= 1.26e-26"):
        loads(text)


@pytest.mark.parametrize("word", ["off", "no", "false", "null"])
def test_terms_are_switched_off_by_one_rule(word):
    """off, no, false or null: no repulsion, no contact, no external force, no lubrication; on: as it is by default."""
    text = (
        "{particles: {number: 4, volume_fraction: 0.1}, flow: {type: steady}, duration: {strain: 1.0}, "
        f"repulsion: {word}, contact: {word}, external: {word}, lubrication: {word}}}"
    )
    config = loads(text)
    assert (config.repulsion, config.contact, config.external) == (None, None, None)
    assert config.lubrication.enabled is False
    assert loads(config.to_yaml()) == config
    assert loads(text.replace(f"lubrication: {word}", "lubrication: on")).lubrication.enabled is True


@pytest.mark.parametrize("word", ["off", "no", "none", "null"])
def test_the_far_field_is_off_by_a_word_that_is_proposed(word):
    text = "{particles: {number: 4, volume_fraction: 0.1}, flow: {type: steady}, duration: {strain: 1.0}, "
    text += "far_field: %s}"
    with pytest.raises(ConfigurationError, match=r"far_field: .*write far_field: self"):
        loads(text % word)


def test_a_start_that_is_typed_belongs_to_the_current_folder(tmp_path, monkeypatch):
    """In the file: beside the file. With --set: in the current folder, and the error names the one beside the file."""
    for name in ("here", "there"):
        (tmp_path / name).mkdir()
    text = "{particles: {number: 4, volume_fraction: 0.1}, flow: {type: steady}, duration: {strain: 1.0}}"
    (tmp_path / "there" / "c.yaml").write_text(text)
    (tmp_path / "there" / "beside.npz").touch()
    (tmp_path / "here" / "typed.npz").touch()
    monkeypatch.chdir(tmp_path / "here")
    config = load("../there/c.yaml", ["particles.initial=typed.npz"])
    assert os.path.samefile(os.path.join(config.directory, config.particles.initial), "typed.npz")
    assert loads(config.to_yaml(), directory=config.directory) == config
    with pytest.raises(ConfigurationError, match=r"not in the current folder.*\.\./there/beside\.npz"):
        load("../there/c.yaml", ["particles.initial=beside.npz"])
    assert load("../there/c.yaml", ["particles.initial=quenched"]).particles.initial == "quenched"
    (tmp_path / "there" / "c.yaml").write_text(text.replace("0.1}", "0.1, initial: beside.npz}"))
    assert load("../there/c.yaml").particles.initial == "beside.npz"
