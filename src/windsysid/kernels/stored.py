"""Serialisation of a compiled function: names as JSON, then object code and bitcode.

Reading executes no code, and imports only modules of Numba and of windsysid. Numba's own form is a pickle, which may
call any function. The types in it are not needed: the caller of `unpacked` gives the signature.
"""

import importlib
import json
import sys
from collections.abc import Callable
from types import ModuleType
from typing import Any

__all__ = ["packed", "unpacked"]

OWN = ("numba", "windsysid")
"""Packages whose modules may be imported."""

_NAMES = ("qualname", "unique_name", "mangled_name", "env_name", "uid", "inline", "noalias")


def packed(result: Any) -> bytes | None:
    """Serialise a `numba.core.compiler.CompileResult`; None if it contains addresses or objects of this process."""
    if result.lifted or result.objectmode or result.reload_init or result.library.has_dynamic_globals:
        return None
    environments = [result.environment, *result._find_referenced_environments()]
    if any(environment.consts or "__name__" not in environment.globals for environment in environments):
        return None
    name, _, (code, bitcode) = result.library.serialize_using_object_code()
    head = {
        "library": name,
        "function": {key: getattr(result.fndesc, key) for key in _NAMES} | {"args": list(result.fndesc.args)},
        "environments": [(one.env_name, one.globals["__name__"]) for one in environments],
        "code": len(code),
    }
    text = json.dumps(head).encode()
    return b"".join((len(text).to_bytes(4, "little"), text, code, bitcode))


def unpacked(payload: bytes, target: Any, function: Callable[..., Any], signature: Any) -> Any:
    """Restore the result of `packed`, compiled from `function` for `signature`.

    Raises
    ------
    Exception
        If the bytes are damaged, or from another build of Numba.
    """
    from numba.core.compiler import CompileResult
    from numba.core.funcdesc import PythonFunctionDescriptor

    end = 4 + int.from_bytes(payload[:4], "little")
    head = json.loads(payload[4:end])
    middle = end + head["code"]
    library = head["library"], "object", (payload[end:middle], payload[middle:])
    named = head["function"]
    described = PythonFunctionDescriptor(
        True, function.__module__, named["qualname"], named["unique_name"], "", None, signature.return_type, None,
        tuple(named["args"]), (), mangler=lambda *_, **__: named["mangled_name"], argtypes=tuple(signature.args),
        inline=named["inline"], noalias=named["noalias"], env_name=named["env_name"], uid=named["uid"],
    )  # fmt: skip
    own, *others = [_environment(name, module) for name, module in head["environments"]]
    return CompileResult._rebuild(target, library, described, own, signature, False, (), "", (), tuple(others))


def _environment(name: str, module: str) -> Any:
    """Environment with the globals of a function's module, made once per process, in which machine code finds them."""
    from numba.core.environment import Environment, lookup_environment

    known = lookup_environment(name)
    if known is not None:
        return known
    made = Environment(_module(module).__dict__)
    made.env_name = name
    Environment._memo[name] = made
    return made


def _module(name: str) -> ModuleType:
    known = sys.modules.get(name)
    if known is None:
        if name.split(".")[0] not in OWN:
            raise ImportError(f"a kernel of module '{name}', which is not loaded")
        known = importlib.import_module(name)
    return known
