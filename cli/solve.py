"""The command `suspend solve`: parsing, calling, printing."""

from __future__ import annotations

import click

from suspend_cli.options import Place, method_options, quiet_option, threads_option, use_threads

EPILOG = """
\b
Examples:
  suspend solve configs/two_spheres.yaml
  suspend solve scene.npz --far-field ewald --accuracy 1e-8 --output answer.h5
  suspend solve scene.npz --no-lubrication --json | jq .eta_r
  suspend solve scene.npz --set lubrication.at_cutoff=hard

\b
A scene in .npz: positions (N,3), L, shift (of the upper image, 0 <= shift < L), forces and
torques (N,3) on the spheres from outside, shear_rate; all but the first two are optional.
Lengths in sphere radii a, forces in 6 pi eta0 a, torques in 6 pi eta0 a^2 (times velocity).
"""


@click.command(epilog=EPILOG)
@click.argument("scene", type=Place())
@method_options(1e-6, "the answer", "the file's; ewald for npz")
@click.option(
    "-o", "--output", type=Place(), metavar="FILE", help="Write the answer (.json, .npz, .h5, .hdf5)."
)
@threads_option
@click.option("--json", "as_json", is_flag=True, help="Print the whole answer as JSON.")
@quiet_option
def solve(scene, output, as_json, quiet, **how) -> None:
    """Velocities, stresslets and viscosity of one configuration.

    SCENE is a configuration (YAML: its initial positions, its flow at t = 0), or an npz archive. Velocities are
    relative to the undisturbed flow at the centres; units are radius, viscosity and shear rate (npz: 6 pi eta0 a).
    """
    if how["threads"] is not None:
        use_threads(how["threads"])
    answer = _solve(scene, output, quiet, **how)
    if output is not None:
        answer.write(output)
        if not quiet:
            click.echo(f"answer written to {output}", err=True)
    if as_json:
        from suspend_cli.report import to_json

        click.echo(to_json(answer.as_dict()))
    elif not quiet:
        click.echo("\n".join(answer.lines()))


def _solve(scene, output, quiet, *, far_field, no_lubrication, accuracy, overrides, threads):
    from suspend.oneshot.answer_files import Answer, check_target
    from suspend.oneshot.problem_files import Choices, read_problem
    from suspend_cli.options import cores

    if output is not None:
        check_target(output)  # before the work
    choices = Choices(far_field, not no_lubrication, accuracy, tuple(overrides), threads or cores())
    problem = read_problem(scene, choices)
    if problem.ignored and not quiet:
        click.echo(f"{scene}: not used: {', '.join(problem.ignored)}", err=True)
    return Answer(problem, problem.solve())
