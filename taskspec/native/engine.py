"""LLVM IR to machine code by llvmlite, a wheel: no compiler on the machine. Only here is llvmlite.

Code is compiled to a relocatable object for this machine's processor, kept by content, and linked
into the process by LLVM's ORC. Fresh and kept code take the same way, so they are the same bytes.
"""

from __future__ import annotations

import ctypes
import hashlib
import json
import threading
from collections.abc import Callable, Iterable
from functools import cache
from typing import Any

from taskspec.native import libm
from taskspec.store import Store

# Of what this module does with IR. Objects of another number are compiled anew.
_SCHEMA = 1
_LOCK = threading.Lock()


class EngineError(Exception):
    """Machine code cannot be made: the message says of what, and why."""


class NotKeptError(EngineError):
    """No machine code is kept, and none was to be made."""


@cache
def missing() -> str | None:
    """Why there is no machine code in this installation, None where there is."""
    try:
        llvm = _llvm()
        llvm.Target.from_default_triple()
    except ImportError:
        return "llvmlite is not installed; `pip install llvmlite` brings it"
    except (OSError, RuntimeError) as error:
        return f"llvmlite does not run here: {error}"
    return None


def available() -> bool:
    """Whether machine code can be made here."""
    return missing() is None


class Engine:
    """Functions of some texts of LLVM IR, as machine code. Threads may share it.

    Their addresses hold for as long as the engine lives.

    Attributes:
        kept: the code was found in the cache.
    """

    def __init__(
        self,
        texts: Iterable[str] | Callable[[], Iterable[str]],
        *,
        level: int = 1,
        store: Store | None = None,
        source: bytes | None = None,
        compiles: bool = True,
    ) -> None:
        """Compiles the texts, or takes what was compiled before.

        Args:
            texts: modules without target triple and data layout. They may call each other's
                functions, and those of `libm` by the names that it gives them. A function that
                makes them is called if they have to be compiled; it goes with a `source`.
            level: LLVM's optimisation, 0 to 3. Bits do not depend on it.
            store: where code is kept; by default under `cache_folder()`.
            source: what the texts follow from, by which their code is found; None for the texts.
            compiles: whether code that is not kept is compiled.

        Raises:
            NotKeptError: no code is kept, and none is to be compiled.
            EngineError: llvmlite is missing; a text is not LLVM IR, calls what is nowhere, or
                defines a function that LLVM calls by itself, such as `floor`.
        """
        refused = missing()
        if refused is not None:
            raise EngineError(refused)
        if source is None:
            texts = tuple(texts() if callable(texts) else texts)
            key = _key([text.encode() for text in texts], level)
        else:
            key = _key([b"source", source], level)
        if store is None:
            store = default_store()
        built = _loaded(store.get(key))
        self.kept = built is not None
        if built is None:
            if not compiles:
                raise NotKeptError
            built = _compiled(tuple(texts() if callable(texts) else texts), level)
            store.put(key, _packed(*built))
        with _LOCK:
            self._code = _Code(*built)

    @property
    def names(self) -> tuple[str, ...]:
        """The functions that have addresses."""
        return tuple(sorted(self._code.addresses))

    def address(self, name: str) -> int:
        """The address of a function.

        Raises:
            KeyError: no text defines it, or only for itself.
        """
        return self._code.addresses[name]

    def function(self, name: str, result: Any, *arguments: Any, brief: bool = False) -> Any:
        """A function as ctypes calls it. It keeps its code alive, and releases the GIL.

        Args:
            name: as in `address`.
            result: its ctypes type, None for none.
            arguments: their ctypes types.
            brief: whether it is so short that it keeps the GIL.
        """
        kind = ctypes.PYFUNCTYPE if brief else ctypes.CFUNCTYPE
        called: Any = kind(result, *arguments)(self.address(name))
        called.code = self._code
        return called


def default_store() -> Store:
    """The store under the user's cache folder, `native` in it."""
    return Store.named("native")


class _Code:
    """An object linked into this process, for as long as it lives."""

    def __init__(self, exports: tuple[str, ...], imports: tuple[str, ...], data: bytes) -> None:
        llvm = _llvm()
        library = llvm.JITLibraryBuilder().add_object_img(data)
        for name in imports:
            library.import_symbol(name, libm.address(name))
        for name in exports:
            library.export_symbol(name)
        # JITLink lays code and constants beside each other, as the small code model needs.
        self._linker = llvm.create_lljit_compiler(use_jit_link=True)
        try:
            self._library = library.link(self._linker, "taskspec")
        except RuntimeError as error:
            raise EngineError(f"machine code cannot be linked: {error}") from None
        self.addresses = {name: int(self._library[name]) for name in exports}


_Built = tuple[tuple[str, ...], tuple[str, ...], bytes]


@cache
def _llvm() -> Any:
    from llvmlite import binding

    binding.initialize_native_target()
    binding.initialize_native_asmprinter()
    return binding


@cache
def _machine_facts() -> tuple[str, str, str]:
    """Triple, processor and its features."""
    llvm = _llvm()
    return (
        llvm.get_process_triple(),
        llvm.get_host_cpu_name(),
        llvm.get_host_cpu_features().flatten(),
    )


def _key(parts: Iterable[bytes], level: int) -> str:
    """Of everything that the machine code depends on."""
    import llvmlite

    digest = hashlib.sha256()
    versions = [str(part) for part in _llvm().llvm_version_info]
    made = f"{_SCHEMA} {level} {llvmlite.__version__} {'.'.join(versions)}"
    for data in (made.encode(), *(fact.encode() for fact in _machine_facts()), *parts):
        digest.update(f"{len(data)} ".encode() + data)
    return digest.hexdigest()


def _compiled(texts: tuple[str, ...], level: int) -> _Built:
    """Names that the object defines, names that it needs, and the object."""
    llvm = _llvm()
    triple, processor, features = _machine_facts()
    # Each engine has a target machine of its own: one that two share ends the process.
    machine = llvm.Target.from_triple(triple).create_target_machine(
        cpu=processor, features=features, opt=level, reloc="pic", codemodel="small", jit=True
    )
    try:
        context = llvm.create_context()
        module = llvm.parse_assembly("", context)
        module.triple, module.data_layout = triple, str(machine.target_data)
        for text in texts:
            module.link_in(llvm.parse_assembly(text, context))
        module.verify()
        if level > 0:
            tuning = llvm.create_pipeline_tuning_options(speed_level=level)
            # Several elements of a loop at once. Sums stay in their order: bits do, too.
            tuning.loop_vectorization = tuning.slp_vectorization = level > 1
            passes = llvm.create_pass_builder(machine, tuning)
            passes.getModulePassManager().run(module, passes)
        data = machine.emit_object(module)
    except RuntimeError as error:
        raise EngineError(f"LLVM refuses the code: {error}") from None
    functions = list(module.functions)
    exports = [f.name for f in functions if not f.is_declaration and _is_seen(f)]
    called = [f.name for f in functions if f.is_declaration and not f.name.startswith("llvm.")]
    nowhere = sorted(set(called) - libm.NAMES)
    if nowhere:
        raise EngineError(f"no text defines {', '.join(nowhere)}, which the code calls")
    taken = sorted(libm.NAMES.intersection(exports))
    if taken:
        raise EngineError(f"a text defines {', '.join(taken)}, which LLVM calls by itself")
    return tuple(exports), tuple({*called, *libm.IMPLIED}), data


def _is_seen(function: Any) -> bool:
    return bool(function.linkage.name == "external")


def _packed(exports: tuple[str, ...], imports: tuple[str, ...], data: bytes) -> bytes:
    return json.dumps([exports, imports]).encode() + b"\n" + data


def _loaded(packed: bytes | None) -> _Built | None:
    if packed is None:
        return None
    head, _, data = packed.partition(b"\n")
    exports, imports = json.loads(head)
    return tuple(exports), tuple(imports), data
