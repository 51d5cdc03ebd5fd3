"""Parallel loops as functions of their own: `for i in numba.prange(n)` becomes a function that runs a part of a loop.

Numba compiles such a loop about four times: as a function, as a ufunc, as that ufunc's wrapper, and once more in the
function around it. A function of its own is compiled once. The source of a kernel stays an ordinary loop, which runs as
it is where nothing is compiled.
"""

from __future__ import annotations
import __future__

import ast
import copy
import functools
import types
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

__all__ = ["Outlined", "outline"]

_FLAGS = __future__.annotations.compiler_flag


class Outlined:
    """A function whose parallel loops have become calls.

    `caller` has `share(loop, first, end, values)` in place of each loop, where `loop` is the name of one of `loops`:
    functions of first, end and the values of the names that the loop reads. Names are those of the caller's module. A
    loop that counts returns its part of the count, and `share` the sum.
    """

    def __init__(self, caller: types.FunctionType, loops: dict[str, types.FunctionType]) -> None:
        self.caller, self.loops = caller, loops


def outline(function: Callable[..., Any], share: str) -> Outlined:
    """Make functions of a kernel's parallel loops; `share`: the name by which its module knows what runs them.

    A loop may write into arrays and count: add whole numbers to one variable. Raises ValueError for a loop that
    returns, of which any other variable is read after it, or that knows an array by two names.
    """
    code, module = function.__code__, function.__globals__
    whole = _definition(code.co_filename, code.co_firstlineno, function.__name__)
    maker = _Maker(whole, share)
    definition = copy.copy(whole)
    definition.body = [made for statement in whole.body for made in maker.statement(statement)]
    definition.decorator_list = []
    made = [_function(each, code.co_filename, module) for each in (definition, *maker.loops)]
    return Outlined(made[0], {loop.__name__: loop for loop in made[1:]})


@functools.cache
def _parsed(path: str) -> ast.Module:
    return ast.parse(Path(path).read_text("utf-8"), path)


def _definition(path: str, line: int, name: str) -> ast.FunctionDef:
    """The definition of a function that starts, with its decorators, in a line of a file."""
    for node in ast.walk(_parsed(path)):
        if isinstance(node, ast.FunctionDef) and node.name == name and line == _first_line(node):
            return node
    raise ValueError(f"{path}:{line}: expected the definition of {name}")


def _first_line(node: ast.FunctionDef) -> int:
    return min([node.lineno, *(decorator.lineno for decorator in node.decorator_list)])


def _function(definition: ast.FunctionDef, path: str, module: dict[str, Any]) -> types.FunctionType:
    """A function of a module from its definition."""
    tree = ast.Module([definition], [])
    found: dict[str, Any] = {}
    exec(compile(tree, path, "exec", _FLAGS, dont_inherit=True), module, found)
    made: types.FunctionType = found[definition.name]
    return made


class _Maker:
    """Replaces the loops of one function and collects their definitions."""

    def __init__(self, whole: ast.FunctionDef, share: str) -> None:
        self.loops: list[ast.FunctionDef] = []
        self._whole, self._share = whole, share
        arguments = whole.args
        self._given = {a.arg for a in (*arguments.posonlyargs, *arguments.args, *arguments.kwonlyargs)}
        self._local = self._given | _names(whole.body, ast.Store)

    def statement(self, statement: ast.stmt) -> list[ast.stmt]:
        """A statement, with the loops in it replaced."""
        if isinstance(statement, ast.For) and _is_parallel(statement):
            return self._call(statement)
        for field in ("body", "orelse"):
            inner = getattr(statement, field, None)
            if inner:
                setattr(statement, field, [made for each in inner for made in self.statement(each)])
        return [statement]

    def _call(self, loop: ast.For) -> list[ast.stmt]:
        where = f"{self._whole.name}, line {loop.lineno}"
        if any(isinstance(node, ast.Return) for node in ast.walk(loop)):
            raise ValueError(f"{where}: a parallel loop that returns: expected one that ends")
        written, read = _names([loop], ast.Store), _names(loop.body, ast.Load)
        late = sorted(written & self._read_after(loop))
        if len(late) > 1 or not all(_only_added_to(name, loop) for name in late):
            raise ValueError(f"{where}: {', '.join(late)}: expected results in arrays, or one count")
        values = (read - _names([loop.target], ast.Store)) & self._local - (written - self._set_before(loop))
        for twice in sorted(values & _renamed(self._whole, values)):
            raise ValueError(f"{where}: {twice}: expected one name for all that the loop knows, not also a part's")
        name = f"_{self._whole.name.strip('_')}_loop{len(self.loops) + 1}"
        self.loops.append(_loop_function(name, sorted(values - set(late)), loop, *late))
        assert isinstance(loop.iter, ast.Call)
        bounds = ", ".join(map(ast.unparse, loop.iter.args))
        bounds = bounds if len(loop.iter.args) > 1 else f"0, {bounds}"
        packed = "".join(f"{value}, " for value in sorted(values - set(late)))
        call = f"{self._share}({name}, {bounds}, ({packed}))"
        return [_parse_at(loop, f"{late[0]} += {call}" if late else call)]

    def _read_after(self, loop: ast.For) -> set[str]:
        """Names that are read below the loop before they are written again."""
        first: dict[str, bool] = {}
        for name, is_read, line in _uses(self._whole):
            if line > (loop.end_lineno or loop.lineno):
                first.setdefault(name, is_read)
        return {name for name, is_read in first.items() if is_read}

    def _set_before(self, loop: ast.For) -> set[str]:
        """Names that have a value where the loop starts: arguments, and what is written above outside other loops."""
        loops = filter(_is_parallel, ast.walk(self._whole))
        inside = {id(node) for each in loops for node in ast.walk(each)}
        return self._given | {
            node.id
            for node in ast.walk(self._whole)
            if isinstance(node, ast.Name) and isinstance(node.ctx, ast.Store)
            if id(node) not in inside and node.lineno < loop.lineno
        }


def _is_parallel(statement: ast.AST) -> bool:
    if not (isinstance(statement, ast.For) and isinstance(statement.iter, ast.Call)):
        return False
    return ast.unparse(statement.iter.func) in ("numba.prange", "prange")


def _names(statements: list[Any], context: type[ast.expr_context]) -> set[str]:
    """Names that are read (or written, by `context`) in statements; an augmented assignment does both."""
    found = set()
    for node in (inner for statement in statements for inner in ast.walk(statement)):
        if isinstance(node, ast.Name) and isinstance(node.ctx, context):
            found.add(node.id)
        elif isinstance(node, ast.AugAssign) and isinstance(node.target, ast.Name):
            found.add(node.target.id)
    return found


def _uses(node: ast.AST) -> Iterator[tuple[str, bool, int]]:
    """Names in the order of their use: whether the value is read, and the line."""
    if isinstance(node, ast.Name):
        yield node.id, isinstance(node.ctx, ast.Load), node.lineno
    elif isinstance(node, ast.AugAssign) and isinstance(node.target, ast.Name):
        yield node.target.id, True, node.lineno
    order = ("value", "iter", "generators", "target")  # these are worked out before what stands to their left
    fields = sorted(node._fields, key=lambda name: order.index(name) if name in order else len(order))
    for name in fields:
        inner = getattr(node, name, None)
        for each in inner if isinstance(inner, list) else [inner]:
            if isinstance(each, ast.AST):
                yield from _uses(each)


def _renamed(whole: ast.FunctionDef, values: set[str]) -> set[str]:
    """Names for parts of other values: fields of records, and parts of arrays."""
    found = set()
    for node in ast.walk(whole):
        if not isinstance(node, ast.Assign):
            continue
        for target in node.targets:
            pairs = [(target, node.value)]
            if isinstance(target, ast.Tuple):
                parts = node.value.elts if isinstance(node.value, ast.Tuple) else [node.value] * len(target.elts)
                pairs = list(zip(target.elts, parts, strict=True))
            found |= {name.id for name, value in pairs if isinstance(name, ast.Name) and _part_of(value) & values}
    return found


def _part_of(value: ast.expr) -> set[str]:
    """The name of which an expression is a part, unless it is a number: an element, or the length of something."""
    while isinstance(value, ast.Attribute | ast.Subscript):
        is_slice = any(isinstance(node, ast.Slice) for node in ast.walk(value))
        if not is_slice and (isinstance(value, ast.Subscript) or value.attr in ("shape", "size")):
            return set()
        value = value.value
    return {value.id} if isinstance(value, ast.Name) else set()


def _only_added_to(name: str, loop: ast.For) -> bool:
    """Whether a loop does nothing with a variable but add to it."""
    added = [node.target for node in ast.walk(loop) if isinstance(node, ast.AugAssign) and isinstance(node.op, ast.Add)]
    uses = [node for node in ast.walk(loop) if isinstance(node, ast.Name) and node.id == name]
    return all(any(node is target for target in added) for node in uses)


def _loop_function(name: str, values: list[str], loop: ast.For, count: str = "") -> ast.FunctionDef:
    """def name(first_, end_, *values): for target in range(first_, end_): ...; it returns its count, if it has one."""
    arguments = ", ".join(("first_", "end_", *values))
    lines = [f"def {name}({arguments}):", " for i in range(first_, end_): pass"]
    if count:
        lines = [lines[0], f" {count} = 0", lines[1], f" return {count}"]
    made = _parse_at(loop, "\n".join(lines))
    assert isinstance(made, ast.FunctionDef)
    inner = next(statement for statement in made.body if isinstance(statement, ast.For))
    inner.target, inner.body = loop.target, loop.body
    return made


def _parse_at(loop: ast.For, text: str) -> ast.stmt:
    """A statement that says that it stands where a loop stands."""
    made = ast.parse(text).body[0]
    for node in ast.walk(made):
        if isinstance(node, ast.expr | ast.stmt | ast.arg):
            node.lineno, node.col_offset, node.end_lineno, node.end_col_offset = loop.lineno, 0, loop.lineno, 0
    return made
