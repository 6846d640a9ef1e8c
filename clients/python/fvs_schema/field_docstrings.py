"""Docstrings of the fields of classes, read from the source: Python does not keep them."""

import ast
import functools
import inspect
import itertools
import sys
from collections.abc import Mapping


@functools.cache
def field_docstrings(module: str) -> Mapping[str, Mapping[str, str]]:
    """The docstrings of the fields of a module's classes, by the names of both."""
    return {
        node.name: {
            field.target.id: inspect.cleandoc(below.value.value)
            for field, below in itertools.pairwise(node.body)
            if isinstance(field, ast.AnnAssign)
            and isinstance(field.target, ast.Name)
            and isinstance(below, ast.Expr)
            and isinstance(below.value, ast.Constant)
            and isinstance(below.value.value, str)
        }
        for node in ast.parse(inspect.getsource(sys.modules[module])).body
        if isinstance(node, ast.ClassDef)
    }
