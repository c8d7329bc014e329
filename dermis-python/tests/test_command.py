"""The commands of the program from Python."""

import inspect
import re

import numpy as np
import pytest

import dermis
from dermis import commands


def test_a_command_returns_what_the_program_prints(tmp_path):
    skin = dermis.Skin.load("skin16")
    mesh = dermis.command("mesh", "skin16", output=tmp_path / "skin16.msh")
    assert mesh["nodes"] == len(skin.mesh.nodes)
    benchmark = dermis.command("benchmark", "skin16", method="noser", twins=1, quick=True)
    assert benchmark["design"] == "skin16" and len(benchmark["twins"]) == 1


def test_arrays_are_given_as_files(tmp_path):
    skin = dermis.Skin.load("skin16")
    position = skin.pixels[np.linalg.norm(skin.pixels - skin.pixels.mean(axis=0), axis=1).argmin()]
    untouched, touched = skin.forward(), skin.forward(skin.touched_conductivity(position))
    table = tmp_path / "contacts.csv"
    dermis.command("contacts", "skin16", frames=[touched], baseline=[untouched], method="noser", output=table)
    rows = np.atleast_1d(np.genfromtxt(table, delimiter=",", names=True))
    contacts = skin.method("noser").contacts([touched], [untouched])
    assert np.array_equal(rows["x_m"], contacts.position_m[:, 0])


@pytest.mark.parametrize(
    ("call", "words"),
    [
        (lambda: dermis.command("nothing"), "there is no command 'nothing'"),
        (lambda: dermis.command("mesh", "skin16", colour=True), "mesh has no option 'colour'"),
        (lambda: dermis.command("mesh", "no-such-design"), "no-such-design"),
        (lambda: dermis.command("benchmark", "skin16", twins=0), "twins"),
    ],
)
def test_errors_are_those_of_the_program(call, words):
    with pytest.raises(dermis.DermisError) as error:
        call()
    assert words in str(error.value)
    assert error.value.message


def test_an_error_in_a_file_names_the_line(tmp_path):
    path = tmp_path / "wrong.toml"
    path.write_text('name = "a"\nbody = 3\n')
    with pytest.raises(dermis.DermisError) as error:
        dermis.command("mesh", path)
    assert error.value.line is not None


def test_every_command_is_a_function_with_help():
    names = dir(commands)
    assert {"bound", "check_frames", "optimise", "live"} <= set(names)
    for name in names:
        function = getattr(commands, name)
        parameters = inspect.signature(function).parameters
        documented = function.__doc__.split("Args:\n")[1]
        assert function.__name__ == name and function.__doc__[0].isupper()
        assert all(re.search(rf"^    {parameter}: \w", documented, re.MULTILINE) for parameter in parameters), name


def test_functions_are_the_commands(tmp_path):
    named = commands.mesh(design="skin16", output=tmp_path / "named.msh")
    assert named == commands.mesh("skin16", output=tmp_path / "named.msh")
    assert named == dermis.command("mesh", "skin16", output=tmp_path / "named.msh")
    with pytest.raises(TypeError, match="colour"):
        commands.mesh("skin16", colour=True)
    with pytest.raises(AttributeError, match="nothing"):
        commands.nothing  # noqa: B018


def test_complex_arrays_stay_complex(tmp_path):
    skin = dermis.Skin.load("skin16")
    frames = skin.forward()[None] * np.exp(0.3j)
    hint = {"baseline": frames, "method": "noser", "output": tmp_path / "c.csv"}
    with pytest.raises(dermis.DermisError, match="complex"):
        commands.contacts("skin16", frames=frames, **hint)
    assert "0 contacts" in commands.contacts("skin16", frames=frames, part="magnitude", **hint)


@pytest.mark.parametrize("frames", [{"a": 1}, dermis.Paired(np.zeros((1, 192))), ["a", "b"]])
def test_what_is_no_argument_is_refused(frames, tmp_path):
    with pytest.raises(dermis.DermisError, match="`frames` is"):
        commands.contacts("skin16", frames=frames, output=tmp_path / "c.csv")
