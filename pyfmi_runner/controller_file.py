"""A user's own controller from a Python file: `run --controller my.py`.

The file defines one subclass of `controllers.interface.Controller`, or a name `controller` that is
an instance of one or a function that makes it.
"""

from __future__ import annotations

import hashlib
import importlib.util
import inspect
import sys
from collections.abc import Callable
from functools import lru_cache
from pathlib import Path
from types import ModuleType
from typing import Any

from controllers.catalogue import controller_named, make_controller
from controllers.interface import Controller
from modelica_fmu.errors import InputError
from modelica_fmu.files import check_source

__all__ = ["SUFFIX", "controller_of", "is_known_controller", "read_controller"]

SUFFIX = ".py"
NAME = "controller"  # what the file may call the one that it offers
EXAMPLE = "`pneugantry controller init my.py` writes one that works"


def is_known_controller(name: str) -> bool:
    """Whether a controller is one of ours, or a file given by its full path."""
    return controller_named(name) or (name.endswith(SUFFIX) and Path(name).is_absolute())


def controller_of(name: str, gains: str | dict[str, float] | None = None) -> Controller:
    """A controller by its name in the catalogue or its file. Raises ValueError for an unknown name
    or gain table, InputError for a file that cannot be used.
    """
    options = {} if gains is None else {"gains": gains}
    if name.endswith(SUFFIX):
        return read_controller(Path(name), **options)
    return make_controller(name, **options)


def read_controller(path: Path, **options: Any) -> Controller:
    """The controller that a Python file offers, made anew. The file is run: give only files that
    you trust. options: what its class takes, as `gains`. Raises InputError naming the file.
    """
    check_source(path)
    try:
        text = path.read_bytes()
    except OSError as error:
        raise InputError(
            f"cannot be read ({error.strerror})", file=path, hint="check the path"
        ) from None
    module = _module(path.resolve(), hashlib.sha256(text).hexdigest())
    offered = _offered(module, path)
    if isinstance(offered, Controller):
        if options:
            raise InputError(
                f"is made without options, got {', '.join(options)}",
                file=path,
                field=NAME,
                hint=f"define a function {NAME}(gains)",
            )
        offered.reset()
        return offered
    return _made(offered, path, options)


@lru_cache(maxsize=64)
def _module(path: Path, digest: str) -> ModuleType:
    """The file run as a module; the same object as long as the file is the same, so that its kernel
    is compiled once.
    """
    name = f"own_controller_{digest[:16]}"
    spec = importlib.util.spec_from_file_location(name, path)
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    sys.modules[name] = module  # pickled states name it
    try:
        spec.loader.exec_module(module)
    except Exception as error:
        del sys.modules[name]
        raise InputError(
            f"cannot be run ({type(error).__name__}{_line_of(error, path)}: {error})",
            file=path,
            hint="correct it",
        ) from None
    return module


def _line_of(error: Exception, path: Path) -> str:
    """Where in the file an error arose."""
    if isinstance(error, SyntaxError):
        return f" in line {error.lineno}"
    trace, line = error.__traceback__, 0
    while trace is not None:
        if trace.tb_frame.f_code.co_filename == str(path):
            line = trace.tb_lineno
        trace = trace.tb_next
    return f" in line {line}" if line else ""


def _offered(module: ModuleType, path: Path) -> Controller | Callable[..., Any]:
    named = getattr(module, NAME, None)
    if isinstance(named, Controller) or callable(named):
        return named
    own = [
        thing
        for thing in vars(module).values()
        if inspect.isclass(thing)
        and issubclass(thing, Controller)
        and thing.__module__ == module.__name__
    ]
    if len(own) == 1:
        return own[0]
    what = "no class" if not own else f"{len(own)} classes ({', '.join(c.__name__ for c in own)})"
    hint = EXAMPLE if not own else f"set {NAME} = {own[0].__name__}"
    raise InputError(f"defines {what} derived from Controller", file=path, hint=hint)


def _made(make: Callable[..., Any], path: Path, options: dict[str, Any]) -> Controller:
    try:
        made = make(**options)
    except Exception as error:
        raise InputError(
            f"cannot be made ({type(error).__name__}{_line_of(error, path)}: {error})",
            file=path,
            field=getattr(make, "__name__", NAME),
            hint="give its arguments defaults, and take what --gains gives as gains",
        ) from None
    if isinstance(made, Controller):
        return made
    raise InputError(
        f"gives {type(made).__name__}, expected a Controller",
        file=path,
        field=NAME,
        hint="derive it from controllers.interface.Controller",
    )
