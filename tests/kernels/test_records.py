"""Fields of records are not addressed by number: packed cameras, view table rows, lenses, tones, depth codings, rules.

The check follows names: parameters that are records by name and annotation, and variables assigned from them.
"""

from __future__ import annotations

import ast
from collections.abc import Iterator
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[2]
FOLDERS = ("engine", "server", "clients", "tests")
# Names of parameters that are a record, or a table of records, if they have one of these annotations.
RECORDS = {
    **dict.fromkeys(("camera", "other", "earlier_camera", "eye", "own", "there", "row", "view", "packed"), ("F64",)),
    **dict.fromkeys(("coding", "earlier_coding", "rules", "tone"), ("F64", "Coding")),
    "lens": ("F32", "int"),
}
TABLES = {**dict.fromkeys(("table", "full", "cameras", "others", "views", "packed"), "F64"), "lenses": "F32"}
MAKERS = ("packed", "table_row")  # attributes and methods that return a record
SIZES = ("CAMERA_SIZE", "TABLE_SIZE", "LENS_SIZE")  # np.zeros of one is a record
TABLE_MAKERS = ("_packed",)  # attributes and functions that return a table


def numbers_in_records(source: str) -> Iterator[tuple[int, str]]:
    """Lines and code of a module's subscripts that address a field of a record by a number."""
    tree = ast.parse(source)
    yield from _in_scope(tree.body, set(), set(), source)


def _in_scope(body: list[ast.stmt], records: set[str], tables: set[str], source: str) -> Iterator[tuple[int, str]]:
    records, tables = set(records), set(tables)
    inner: list[ast.stmt] = []
    for node in _walk(body):
        if isinstance(node, ast.ClassDef):
            inner += node.body
        elif isinstance(node, ast.FunctionDef):
            new_records, new_tables = _parameters(node)
            yield from _in_scope(node.body, records | new_records, tables | new_tables, source)
        elif isinstance(node, ast.Assign):
            for name, value in _bindings(node):
                (records.add if _is_record(value, records, tables) else records.discard)(name)
                (tables.add if _is_table(value, records, tables) else tables.discard)(name)
    for node in _walk(body):
        if _names_a_field_by_number(node, records, tables):
            yield node.lineno, ast.get_source_segment(source, node) or ""  # type: ignore[attr-defined]
    if inner:
        yield from _in_scope(inner, records, tables, source)


def _walk(body: list[ast.stmt]) -> Iterator[ast.AST]:
    """Nodes in order, without the contents of functions and classes."""
    todo: list[ast.AST] = list(reversed(body))
    while todo:
        node = todo.pop()
        yield node
        if not isinstance(node, ast.FunctionDef | ast.ClassDef):
            todo += reversed(list(ast.iter_child_nodes(node)))


def _parameters(function: ast.FunctionDef) -> tuple[set[str], set[str]]:
    records, tables = set(), set()
    for argument in [*function.args.posonlyargs, *function.args.args, *function.args.kwonlyargs]:
        annotation = ast.unparse(argument.annotation) if argument.annotation else ""
        annotation = {"npt.NDArray[np.float64]": "F64", "npt.NDArray[np.float32]": "F32"}.get(annotation, annotation)
        if annotation in RECORDS.get(argument.arg, ()):
            records.add(argument.arg)
        if annotation and annotation == TABLES.get(argument.arg):
            tables.add(argument.arg)
    return records, tables


def _bindings(node: ast.Assign) -> Iterator[tuple[str, ast.expr]]:
    for target in node.targets:
        if isinstance(target, ast.Name):
            yield target.id, node.value
        elif isinstance(target, ast.Tuple) and isinstance(node.value, ast.Tuple):
            for part, value in zip(target.elts, node.value.elts, strict=False):
                if isinstance(part, ast.Name):
                    yield part.id, value


def _name(node: ast.expr) -> str:
    return node.id if isinstance(node, ast.Name) else node.attr if isinstance(node, ast.Attribute) else ""


def _is_record(node: ast.expr, records: set[str], tables: set[str]) -> bool:
    if isinstance(node, ast.Call):
        if _name(node.func) == "to_fixed_tuple":
            return _is_record(node.args[0], records, tables)
        if _name(node.func) in ("zeros", "empty"):
            return _name(node.args[0]) in SIZES
        return isinstance(node.func, ast.Attribute) and node.func.attr in MAKERS
    if isinstance(node, ast.Subscript):
        return _is_table(node.value, records, tables) and not isinstance(node.slice, ast.Tuple | ast.Slice)
    if isinstance(node, ast.Attribute):
        return node.attr in MAKERS
    return isinstance(node, ast.Name) and node.id in records


def _is_table(node: ast.expr, records: set[str], tables: set[str]) -> bool:
    if isinstance(node, ast.Call):
        return _name(node.func) in TABLE_MAKERS or (
            _name(node.func) in ("array", "stack")
            and bool(node.args)
            and isinstance(node.args[0], ast.ListComp)
            and _is_record(node.args[0].elt, records, tables)
        )
    if isinstance(node, ast.Subscript):  # cameras[:, None]
        return _is_table(node.value, records, tables) and isinstance(node.slice, ast.Tuple)
    if isinstance(node, ast.Attribute):
        return node.attr in TABLE_MAKERS or (node.attr == "rows" and _name(node.value) in ("present", "views", "table"))
    return isinstance(node, ast.Name) and node.id in tables


def _is_number(index: ast.expr) -> bool:
    if isinstance(index, ast.Slice):
        return any(part is not None and _is_number(part) for part in (index.lower, index.upper))
    if isinstance(index, ast.BinOp):  # row[7 + i]
        return _is_number(index.left) or (_is_number(index.right) and not _is_constant(index.left))
    return isinstance(index, ast.Constant) and type(index.value) is int


def _is_constant(index: ast.expr) -> bool:
    return isinstance(index, ast.Name) and index.id.isupper()


def _names_a_field_by_number(node: ast.AST, records: set[str], tables: set[str]) -> bool:
    if isinstance(node, ast.Call) and _name(node.func).startswith("load"):  # load_f32(lens, 9)
        return len(node.args) > 1 and _is_record(node.args[0], records, tables) and _is_number(node.args[1])
    if not isinstance(node, ast.Subscript):
        return False
    if _is_record(node.value, records, tables):
        return not isinstance(node.slice, ast.Tuple) and _is_number(node.slice)
    last = node.slice.elts[-1] if isinstance(node.slice, ast.Tuple) and len(node.slice.elts) > 1 else None
    return last is not None and _is_table(node.value, records, tables) and _is_number(last)


MODULES = [path for folder in FOLDERS for path in sorted((ROOT / folder).rglob("*.py"))]


def test_no_number_stands_for_a_field_of_a_record():
    found = [
        f"{path.relative_to(ROOT)}:{line}: {code}"
        for path in MODULES
        for line, code in numbers_in_records(path.read_text())
    ]
    assert not found, "\n".join(["a field of a record has a name (support/packed.py and others):", *found])


@pytest.mark.parametrize(
    "source",
    [
        "def f(camera: F64): return camera[16]",
        "def f(camera: F64): return 1.0, camera[3] * x",
        "def f(row: F64, i: int): return row[7 + i]",
        "def f(table: F64, k: int): return table[k, 19]",
        "def f(table: F64, k: int): return table[k][1]",
        "def f(coding: F64): least = int(coding[2])",
        "def f(camera: F64):\n    first = to_fixed_tuple(camera, 20)\n    return first[7]",
        "def f(lens: int): return load_f32(lens, 9)",
        "distance = present.rows[:, 16:19] - target.packed[16:19]",
        "packed = camera.packed(origin)\nu = packed[5]",
        "def f(packed: npt.NDArray[np.float64]): return packed[5]",
        "out = np.zeros(CAMERA_SIZE)\nout[7:16] = rotation",
        "def f(cameras: F64): return cameras[:, None][:, :, 1:7]",
        "away = np.array([camera.packed() for camera in cameras])[:, 16:19]",
    ],
)
def test_numbers_are_found(source):
    assert list(numbers_in_records(source))


@pytest.mark.parametrize(
    "source",
    [
        "def f(camera: F64): return camera[FX]",
        "def f(row: F64, i: int): return row[FORWARD_X + i] + row[k]",
        "def f(row: U16): return row[0]",
        "def f(table: F64, addresses: I64): return table[0], addresses[0, 0]",
        "def f(cameras: Sequence[Camera]): return cameras[0]",
        "def f(coding: Coding): return coding.step",
    ],
)
def test_names_and_other_arrays_are_left_alone(source):
    assert not list(numbers_in_records(source))
