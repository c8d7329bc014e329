"""The commands of the program `dermis` as functions: the same names, options, defaults and results.

>>> from dermis import commands
>>> bounds = commands.bound("skin16", twin="lab", separation_step=0)
>>> round(bounds["bounds"][0]["sd_m"]["median"], 4)
0.0013

`dir(commands)` lists them; `help(commands.bound)` shows the arguments. Each call is `dermis.command` with that name: it runs
in a process of its own, takes arrays where the program takes files of frames, returns the JSON that the program prints, and
raises `DermisError`.
"""

from collections.abc import Callable
from inspect import Parameter, Signature
from textwrap import indent
from typing import Any

from dermis._command import command, described

_KINDS = {"none": "bool", "several": "list", "repeated": "list"}


def __dir__() -> list[str]:
    return sorted(_identifier(name) for name in described())


def __getattr__(name: str) -> Callable[..., Any]:
    of_program = next((known for known in described() if _identifier(known) == name), None)
    if of_program is None:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    function = _function(of_program)
    globals()[name] = function
    return function


def _function(of_program: str) -> Callable[..., Any]:
    about, arguments = described()[of_program]["about"], described()[of_program]["arguments"]
    names = [argument["name"] for argument in arguments if argument["is_positional"]]
    parameters = [_parameter(argument) for argument in arguments]
    signature = Signature(sorted(parameters, key=lambda parameter: parameter.kind))

    def function(*positional: Any, **options: Any) -> Any:
        bound = signature.bind(*positional, **options).arguments
        given = [bound.pop(_identifier(name)) for name in names if _identifier(name) in bound]
        return command(of_program, *given, **bound)

    function.__name__ = function.__qualname__ = _identifier(of_program)
    function.__module__ = __name__
    function.__doc__ = f"{about}\n\nArgs:\n{indent(''.join(map(_line, arguments)), '    ')}"
    function.__signature__ = signature  # type: ignore[attr-defined]
    return function


def _identifier(name: str) -> str:
    """The name of an option or command in Python: `for` is a keyword."""
    return f"{name.replace('-', '_').replace(' ', '_')}{'_' if name == 'for' else ''}"


def _parameter(argument: dict[str, Any]) -> Parameter:
    kind = Parameter.POSITIONAL_OR_KEYWORD if argument["is_positional"] else Parameter.KEYWORD_ONLY
    default = Parameter.empty if argument["is_positional"] and argument["is_required"] else None
    return Parameter(_identifier(argument["name"]), kind, default=default)


def _line(argument: dict[str, Any]) -> str:
    """An argument in the documentation of its function."""
    notes = [_KINDS[argument["takes"]]] if argument["takes"] in _KINDS else []
    notes += [f"one of {', '.join(argument['choices'])}"] if argument["choices"] else []
    notes += [f"default {argument['default']}"] if argument["default"] else []
    remark = f" ({'; '.join(notes)})" if notes else ""
    return f"{_identifier(argument['name'])}: {argument['help']}{remark}\n"
