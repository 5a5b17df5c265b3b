"""The type stubs and the extension module have the same names, arguments and defaults."""

import ast
import inspect
from pathlib import Path

import oblate
from oblate import _oblate

STUBS = ast.parse((Path(oblate.__file__).parent / "_oblate.pyi").read_text())


def arguments(function: ast.FunctionDef, skip: int) -> dict[str, object]:
    """Names with defaults; `...` stands for none."""
    given = function.args
    positional = given.args[skip:]
    missing = [...] * (len(positional) - len(given.defaults))
    defaults = missing + [ast.literal_eval(default) for default in given.defaults]
    keywords = [... if default is None else ast.literal_eval(default) for default in given.kw_defaults]
    names = [argument.arg for argument in positional + given.kwonlyargs]
    return dict(zip(names, defaults + keywords, strict=True))


def signature(thing: object) -> dict[str, object]:
    parameters = inspect.signature(thing).parameters.values()
    of = {p.name: ... if p.default is p.empty else p.default for p in parameters}
    of.pop("self", None)
    return of


def test_every_name_of_the_module_has_a_stub():
    names = {node.name for node in STUBS.body if isinstance(node, (ast.ClassDef, ast.FunctionDef))}
    assert names | {"__version__"} == set(_oblate.__all__)
    assert names - {"_restore_fit"} < set(oblate.__all__)
    assert all(hasattr(oblate, name) for name in oblate.__all__)


def test_classes_have_the_methods_and_arguments_of_their_stubs():
    checked = 0
    for node in STUBS.body:
        if not isinstance(node, ast.ClassDef) or node.name in ("OblateError", "Marginal"):
            continue
        there = getattr(oblate, node.name)
        methods = {item.name: item for item in node.body if isinstance(item, ast.FunctionDef)}
        public = {name for name in vars(there) if not name.startswith("_")}
        assert public == {name for name in methods if not name.startswith("_")}, node.name
        for name, stub in methods.items():
            decorators = {decorator.id for decorator in stub.decorator_list}
            if name == "__len__" or "property" in decorators:
                assert hasattr(there, name)
                continue
            thing = there if name == "__new__" else getattr(there, name)
            skip = 0 if "staticmethod" in decorators else 1
            assert signature(thing) == arguments(stub, skip), f"{node.name}.{name}"
            assert name == "__new__" or thing.__doc__, f"{node.name}.{name} has no description"
            checked += 1
    assert checked > 15


def test_functions_have_the_arguments_of_their_stubs():
    whole = {}
    for node in STUBS.body:
        if isinstance(node, ast.FunctionDef):
            whole.setdefault(node.name, {}).update(arguments(node, 0))
    assert set(whole) == {"_restore_fit", "sample"}
    for name, stub in whole.items():
        assert signature(getattr(_oblate, name)) == stub, name
        assert getattr(_oblate, name).__doc__
