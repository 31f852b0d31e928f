"""A method in a Python file of the user: `path/to/file.py:function`, without a package or an entry point."""

from __future__ import annotations

import hashlib
import importlib.util
import sys
from dataclasses import dataclass
from pathlib import Path
from types import ModuleType

from roundel.scenes.errors import UsageError, did_you_mean, first_line
from roundel.solver.methods.plugin import Finder

SUFFIX = ".py"
FUNCTION = "find"
MODULE = "roundel_method_"  # of imported files


@dataclass(frozen=True)
class MethodFile:
    """A function of a file, as the argument `--method` names it.

    Attributes
    ----------
    path : Path
        The file, absolute.
    function : str
        `find` if the argument has no function.
    """

    path: Path
    function: str = FUNCTION

    @classmethod
    def of(cls, text: str) -> MethodFile | None:
        """The file and function of a method's name; None if the name is not that of a file."""
        head, _, function = text.rpartition(":")
        if head.endswith(SUFFIX):
            return cls(Path(head).absolute(), function)
        return cls(Path(text).absolute()) if text.endswith(SUFFIX) else None

    @property
    def name(self) -> str:
        """The method's name in estimates and reports: the function's, or the file's where the function is `find`."""
        return self.path.stem if self.function == FUNCTION else self.function

    def __str__(self) -> str:
        """The argument, with the whole path: it has the same meaning in every folder."""
        return f"{self.path}:{self.function}"

    def load(self) -> Finder:
        """The function.

        Raises
        ------
        UsageError
            If there is no such file or function, or the file cannot be imported.
        """
        try:
            source = self.path.read_bytes()
        except OSError as error:
            raise UsageError(f"method {self}: {self.path} cannot be read: {error.strerror}") from error
        module = _module(self.path, source)
        finder = vars(module).get(self.function)
        if finder is None:
            own = [
                n for n, v in vars(module).items() if callable(v) and getattr(v, "__module__", "") == module.__name__
            ]
            hint = did_you_mean(self.function, own) or f"it has {', '.join(own) or 'no function'}"
            raise UsageError(f"method {self}: {self.path.name} has no function {self.function!r}; {hint}")
        if not callable(finder):
            raise UsageError(f"method {self}: {self.function!r} is not callable; give a function of a View")
        return finder  # type: ignore[no-any-return]

    def stamp(self) -> tuple[object, ...]:
        """What tells two versions of the method apart: its source, and the files beside it, such as weights."""
        beside = sorted(f for f in self.path.parent.iterdir() if f.is_file())
        return (self.path.read_bytes(), *((f.name, f.stat().st_mtime_ns, f.stat().st_size) for f in beside))


def _module(path: Path, source: bytes) -> ModuleType:
    """The imported file; a file that has not changed is executed once."""
    digest = hashlib.sha256(str(path).encode() + b"\0" + source).hexdigest()[:16]
    name = f"{MODULE}{digest}"
    if name in sys.modules:
        return sys.modules[name]
    spec = importlib.util.spec_from_file_location(name, path)
    assert spec is not None, "the name ends in .py"
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    # It may import its neighbours, as a script does; last, so that they hide no installed package.
    if str(path.parent) not in sys.path:
        sys.path.append(str(path.parent))
    sys.modules[name] = module
    try:
        spec.loader.exec_module(module)
    except (Exception, SystemExit) as error:  # third-party code
        del sys.modules[name]
        raise UsageError(f"method {path}: cannot be imported: {type(error).__name__}: {first_line(error)}") from error
    return module
