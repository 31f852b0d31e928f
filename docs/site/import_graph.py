"""The import graph of the packages as SVG: who imports whom, drawn from the source."""

from __future__ import annotations

import ast
from pathlib import Path

FOLDERS = ("scenes", "datasets", "render", "solver", "validate", "cli")
_WIDTH, _ROW, _BOX, _GAP, _MARGIN = 860, 74, 118, 14, 16


def imports_of(root: Path) -> dict[str, set[str]]:
    """Packages (`solver/fit`, or `cli`) and the packages that each imports, without imports for type checking alone."""
    graph: dict[str, set[str]] = {}
    for path in (p for folder in FOLDERS for p in sorted((root / folder).rglob("*.py"))):
        source = _package(path.relative_to(root).with_suffix("").parts)
        graph.setdefault(source, set())
        tree = ast.parse(path.read_text(encoding="utf-8"))
        typing = {id(n) for node in ast.walk(tree) if _is_type_checking(node) for n in ast.walk(node)}
        for node in ast.walk(tree):
            if isinstance(node, ast.ImportFrom) and node.module and id(node) not in typing:
                parts = tuple(node.module.split("."))
                if parts[0] == "roundel" and len(parts) > 1 and parts[1] in FOLDERS:
                    graph[source].add(_package(parts[1:]))
    return {name: targets - {name} for name, targets in graph.items() if name}


def _is_type_checking(node: ast.AST) -> bool:
    return isinstance(node, ast.If) and isinstance(node.test, ast.Name) and node.test.id == "TYPE_CHECKING"


def _package(parts: tuple[str, ...]) -> str:
    return "/".join(parts[:2]) if len(parts) > 2 else parts[0]


def levels_of(graph: dict[str, set[str]]) -> dict[str, int]:
    """Floor of each package: one above the highest that it imports. Modules at a folder's root count as one package."""
    levels: dict[str, int] = {}

    def level(name: str, above: tuple[str, ...]) -> int:
        if name in above:  # a folder's own root and its packages may import each other
            return 0
        if name not in levels:
            below = [level(t, (*above, name)) for t in graph.get(name, ()) if t != name.split("/", maxsplit=1)[0]]
            levels[name] = 1 + max(below, default=-1)
        return levels[name]

    for name in sorted(graph):
        level(name, ())
    return levels


def draw_graph(root: Path) -> str:
    """The graph as SVG: a column a folder, lowest packages at the bottom, hover for what each imports."""
    graph = imports_of(root)
    levels = levels_of(graph)
    columns = {folder: [n for n in graph if n.split("/")[0] == folder] for folder in FOLDERS}
    rows = {folder: sorted(names, key=lambda n: (-levels[n], n)) for folder, names in columns.items()}
    height = 2 * _MARGIN + 40 + max(map(len, rows.values())) * 40
    step = (_WIDTH - 2 * _MARGIN) / len(FOLDERS)
    place = {}
    for i, folder in enumerate(FOLDERS):
        for k, name in enumerate(rows[folder]):
            place[name] = (_MARGIN + i * step, height - _MARGIN - 40 * (len(rows[folder]) - k))
    parts = [
        f'<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 {_WIDTH} {height}" role="img" '
        'aria-label="Packages of Roundel and their imports" font-family="sans-serif" font-size="12">',
        f'<rect width="{_WIDTH}" height="{height}" fill="#ffffff"/>',
    ]
    for name, targets in sorted(graph.items()):
        for target in sorted(targets):
            if target in place and name.split("/")[0] != target.split("/")[0]:
                (x1, y1), (x2, y2) = place[name], place[target]
                parts.append(
                    f'<path d="M{x1:.0f},{y1 + 15:.0f} C{x1 - 30:.0f},{y1 + 15:.0f} {x2 + _BOX + 30:.0f},{y2 + 15:.0f} '
                    f'{x2 + _BOX:.0f},{y2 + 15:.0f}" fill="none" stroke="#7a8aa0" stroke-opacity="0.35"/>'
                )
    for i, folder in enumerate(FOLDERS):
        parts.append(f'<text x="{_MARGIN + i * step:.0f}" y="{_MARGIN + 12}" font-weight="bold">{folder}</text>')
    for name, (x, y) in place.items():
        label = name.split("/")[1] if "/" in name else f"{name} (top)"
        imports = ", ".join(sorted(graph[name])) or "nothing of Roundel"
        parts.append(
            f'<g><title>{name} imports {imports}</title><rect x="{x:.0f}" y="{y:.0f}" width="{_BOX}" height="30" '
            f'rx="5" fill="#eef3fa" stroke="#44608a"/><text x="{x + 8:.0f}" y="{y + 19:.0f}">{label}</text></g>'
        )
    return "\n".join([*parts, "</svg>", ""])
