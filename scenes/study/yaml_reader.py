"""YAML 1.2 scalars with the line and column of every value.

PyYAML parses the syntax; this module resolves scalars by the core schema of YAML 1.2.2 (section 10.3), so that `1e-3`
is a number and `no` is a string. Aliases, tags and duplicate keys are refused; size and depth are limited.
"""

from __future__ import annotations

import re
from pathlib import Path
from typing import Any

import yaml

from roundel.scenes.errors import StudyError, first_line

MAX_BYTES = 1_000_000
MAX_DEPTH = 20

Path_ = tuple[str | int, ...]
Marks = dict[Path_, tuple[int, int]]

_INT = re.compile(r"[-+]?[0-9]+\Z")
_BASED = re.compile(r"0o[0-7]+\Z|0x[0-9a-fA-F]+\Z")
_FLOAT = re.compile(r"[-+]?(\.[0-9]+|[0-9]+(\.[0-9]*)?)([eE][-+]?[0-9]+)?\Z")
_INF = re.compile(r"[-+]?\.(inf|Inf|INF)\Z")
_NAN = re.compile(r"\.(nan|NaN|NAN)\Z")
_WORDS = {
    **dict.fromkeys(("", "~", "null", "Null", "NULL"), None),
    **dict.fromkeys(("true", "True", "TRUE"), True),
    **dict.fromkeys(("false", "False", "FALSE"), False),
}


def _scalar(text: str) -> Any:
    if text in _WORDS:
        return _WORDS[text]
    # Very long digit strings are not valid numbers of a study, and int() takes quadratic time for them.
    if len(text) <= 64:
        if _INT.match(text):
            return int(text)
        if _BASED.match(text):
            return int(text, 0)
        if _FLOAT.match(text):
            return float(text)
    if _INF.match(text):
        return float(text.replace(".", ""))
    if _NAN.match(text):
        return float("nan")
    return text


class _Reader:
    def __init__(self, path: Path) -> None:
        self.path = path
        self.marks: Marks = {}

    def fail(self, message: str, node: yaml.Node) -> StudyError:
        return StudyError(message, self.path, node.start_mark.line + 1, node.start_mark.column + 1)

    def value(self, node: yaml.Node, where: Path_) -> Any:
        self.marks.setdefault(where, (node.start_mark.line + 1, node.start_mark.column + 1))
        if isinstance(node, yaml.ScalarNode):
            return _scalar(node.value) if node.style is None else node.value
        if isinstance(node, yaml.SequenceNode):
            return [self.value(item, (*where, i)) for i, item in enumerate(node.value)]
        assert isinstance(node, yaml.MappingNode)
        out: dict[str, Any] = {}
        for key_node, value_node in node.value:
            if not isinstance(key_node, yaml.ScalarNode):
                raise self.fail("a key must be a scalar", key_node)
            key = key_node.value
            if key in out:
                raise self.fail(f"{key}: duplicate key; keep one", key_node)
            self.marks[(*where, key)] = (key_node.start_mark.line + 1, key_node.start_mark.column + 1)
            out[key] = self.value(value_node, (*where, key))
        return out


def _check_events(text: str, path: Path) -> None:
    depth = 0
    for event in yaml.parse(text, Loader=yaml.SafeLoader):
        mark: Any = event.start_mark
        line, column = mark.line + 1, mark.column + 1
        if isinstance(event, yaml.AliasEvent) or getattr(event, "anchor", None):
            raise StudyError("anchors and aliases are not supported; write the value out", path, line, column)
        if tag := getattr(event, "tag", None):
            raise StudyError(f"the tag {tag} is not supported; remove it", path, line, column)
        if isinstance(event, yaml.CollectionStartEvent):
            depth += 1
            if depth > MAX_DEPTH:
                raise StudyError(f"nested deeper than {MAX_DEPTH} levels", path, line, column)
        elif isinstance(event, yaml.CollectionEndEvent):
            depth -= 1


def read_yaml(path: str | Path) -> tuple[Any, Marks]:
    """Read a YAML file into plain values, with the position of each.

    Parameters
    ----------
    path : path

    Returns
    -------
    value : dict, list or scalar
    marks : dict
        From the path of a value, a tuple of keys and indices, to (line, column), both from 1.

    Raises
    ------
    StudyError
        If anything cannot be read; with its position.
    """
    path = Path(path)
    try:
        with path.open("rb") as file:
            data = file.read(MAX_BYTES + 1)  # of a device no more
    except OSError as error:
        raise StudyError(f"cannot read the study: {error.strerror}", path) from error
    if len(data) > MAX_BYTES:
        raise StudyError(f"larger than {MAX_BYTES} bytes, the limit for a study", path)
    try:
        text = data.decode("utf-8-sig")
        _check_events(text, path)
        node = yaml.compose(text, Loader=yaml.SafeLoader)
    except UnicodeDecodeError as error:
        raise StudyError(f"not UTF-8 text at byte {error.start}; is this a study?", path) from error
    except yaml.MarkedYAMLError as error:
        mark = error.problem_mark or error.context_mark
        line, column = (mark.line + 1, mark.column + 1) if mark else (1, 1)
        raise StudyError(f"not YAML: {error.problem or error.context}", path, line, column) from error
    except yaml.YAMLError as error:
        raise StudyError(f"not YAML: {first_line(error)}", path) from error
    if node is None:
        raise StudyError("the study is empty", path)
    reader = _Reader(path)
    return reader.value(node, ()), reader.marks
