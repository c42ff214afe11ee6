"""The definition of a service: what its class says, checked and ready to be called.

From the annotations of each method follow the classes of its request and its answer, exactly as
those of the engine's operations: the check of what comes in, JSON Schema, OpenAPI and ROS types
are the same code.
"""

from __future__ import annotations

import inspect
import re
import sys
import types
import typing
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace
from typing import Annotated, Any, Literal, TypeVar

from pydantic import BaseModel, Field, create_model
from pydantic_core import ValidationError

from rtask.engine.context import SCOPES
from rtask.errors import ServiceFailedError, UsageError
from rtask.services.call import Call
from rtask.services.service import Executor, Mark, ResourceNeed, Service, marked, own_attributes
from rtask.wire.effect import EFFECTS, Effect
from rtask.wire.message import Answer, Message
from rtask.wire.types import Bytes, Carried, Flag, Number, Text, Whole

__all__ = ["Definition", "Method", "check_name", "define", "split_name"]

M = TypeVar("M", bound=BaseModel)
Invoke = Callable[[Any, Message, Call], Any]

_NAME = re.compile(r"[A-Za-z][A-Za-z0-9_]{0,63}/[A-Za-z][A-Za-z0-9_]{0,63}")
_VERSION = re.compile(r"(0|[1-9]\d*)\.(0|[1-9]\d*)\.(0|[1-9]\d*)")
# Their fields have no docstrings of their own that pydantic would have to look for in the source.
_PLAIN_CLASS = {"use_attribute_docstrings": False}
_PLAIN: Mapping[Any, Any] = {float: Number, int: Whole, bool: Flag, str: Text, bytes: Bytes}


@dataclass(frozen=True)
class Method:
    """One method of a service.

    Parameters
    ----------
    name
        As in the class.
    summary, description
        First line and rest of its docstring.
    scope
        Right that a caller needs.
    effect
        What a call does to the graph and to datasets.
    request, answer
        Their declarations.
    output
        Name of the only field of the answer; empty where the method returns a message.
    invoke
        Calls the method of an instance.
    """

    name: str
    summary: str
    description: str
    scope: str
    effect: Effect
    request: type[Message]
    answer: type[Answer]
    output: str
    invoke: Invoke = field(repr=False, compare=False)

    def carry_out(self, instance: Any, request: Message, call: Call) -> Answer:
        """Call the method and return its answer.

        Raises
        ------
        ServiceFailedError
            It returned something else than it declares.
        """
        result = self.invoke(instance, request, call)
        if isinstance(result, self.answer):
            return result
        if self.output:
            result = {self.output: result}
        elif result is None and not self.answer.model_fields:
            return self.answer()
        try:
            return self.answer.model_validate(result)
        except ValidationError as error:
            first = error.errors(include_url=False)[0]
            place = ".".join(str(part) for part in first["loc"])
            raise ServiceFailedError(
                f"{self.name} returned what it does not declare: {place}: {first['msg']}",
                method=self.name,
            ) from error


@dataclass(frozen=True)
class Definition:
    """One version of a service.

    Parameters
    ----------
    name, version
        ``example/Kinematics``, ``1.2.0``.
    summary, description
        First line and rest of its docstring.
    make
        Returns an instance for data resources; the instance is not ready yet.
    source
        Where a worker process finds the class: ``module:Class`` or ``file.py:Class``; empty where
        it must stay in this process.
    extra
        Extra of RTASK whose libraries it needs.
    """

    name: str
    version: str
    summary: str
    description: str
    methods: Mapping[str, Method]
    resources: Mapping[str, ResourceNeed]
    make: Callable[[Mapping[str, Any]], Any] = field(repr=False, compare=False)
    executor: Executor = "threads"
    max_workers: int | None = None
    max_waiting: int = 100
    timeout_s: float = 60.0
    source: str = ""
    extra: str = ""

    @property
    def exact(self) -> str:
        """Name with version."""
        return f"{self.name}@{self.version}"

    @property
    def is_writing(self) -> bool:
        """Whether it may write to its data resources, so that it has one worker."""
        return any(need.writable for need in self.resources.values())


def split_name(name: str) -> tuple[str, str]:
    """Return the name of a service and the wanted version, which may be empty.

    Examples
    --------
    >>> split_name("example/Kinematics@1.*"), split_name("example/Kinematics")
    (('example/Kinematics', '1.*'), ('example/Kinematics', ''))
    """
    plain, _, version = name.strip("/").partition("@")
    return plain, version


_DEFINED: dict[type[Service], Definition] = {}


def check_name(name: str, version: str) -> None:
    """Refuse what is not the name or the version of a service.

    Raises
    ------
    UsageError
        With the form that is expected.
    """
    if not _NAME.fullmatch(name):
        raise UsageError(f"name {name!r}; expected <namespace>/<name>")
    if not _VERSION.fullmatch(version):
        raise UsageError(f"version {version!r} of {name}; expected 1.2.3")


def define(service: type[Service]) -> Definition:
    """Return the definition of a class, which is made once: that takes 20 ms.

    Raises
    ------
    UsageError
        Name or version are missing, or a parameter or a result is not annotated with a type that
        can be sent; with file, line and parameter.
    """
    if service not in _DEFINED:
        _DEFINED[service] = _definition(service)
    return _DEFINED[service]


def _definition(service: type[Service]) -> Definition:
    try:
        check_name(service.name, service.version)
    except UsageError as error:
        raise UsageError(f"{_place(service)}: {service.__name__}: {error}") from None
    methods = {name: _method(service, name, mark) for name, mark in marked(service).items()}
    if not methods:
        raise UsageError(
            f"{_place(service)}: {service.__name__} has no method; mark them with @method"
        )
    needs = {n: need for n, need in own_attributes(service) if isinstance(need, ResourceNeed)}
    is_apart = service.executor in ("processes", "ray")
    if is_apart and any(need.type == "graph" for need in needs.values()):
        raise UsageError(
            f"{_place(service)}: {service.name}: the graph is in this process; use threads"
        )
    summary, description = _words(service)
    return Definition(
        service.name, service.version, summary, description, methods, needs, service,
        service.executor, service.max_workers, service.max_waiting, service.timeout_s,
        _source(service), service.extra,
    )  # fmt: skip


def _model(name: str, base: type[M], summary: str, fields: dict[str, Any]) -> type[M]:
    return create_model(name, __base__=base, __doc__=summary, __cls_kwargs__=_PLAIN_CLASS, **fields)


@dataclass(frozen=True)
class _Where:
    """The place of a mistake; looked up only when there is one, because that takes long."""

    declared: Any
    name: str

    def of(self, part: str) -> _Where:
        return replace(self, name=f"{self.name}: {part}")

    def error(self, words: str) -> UsageError:
        return UsageError(f"{_place(self.declared)}: {self.name}: {words}")


def _method(service: type[Service], name: str, mark: Mark) -> Method:
    function = next(vars(base)[name] for base in service.__mro__ if name in vars(base))
    where = _Where(function, f"{service.__name__}.{name}")
    if not any(mark.scope in scopes for scopes in SCOPES.values()):
        raise where.error(f"no role holds the scope {mark.scope!r}")
    hints = _hints(function, where)
    stem = "".join(part[:1].upper() + part[1:] for part in [*service.name.split("/"), name])
    meanings = _meanings(inspect.getdoc(function) or "")
    parameters = inspect.signature(function).parameters
    fields: dict[str, Any] = {}
    call_name = ""
    for parameter in [] if mark.inputs is not None else list(parameters.values())[1:]:
        own = parameter.name
        if hints.get(own) is Call:
            call_name = own
            continue
        if own not in hints:
            raise where.error(f"parameter {own!r} has no annotation")
        if parameter.kind in (parameter.VAR_POSITIONAL, parameter.VAR_KEYWORD):
            raise where.error(f"parameter {own!r}: name each input by itself")
        default = ... if parameter.default is parameter.empty else parameter.default
        fields[own] = _field(hints[own], default, meanings.get(own, own), where.of(own))
    for own, type_ in (mark.inputs or {}).items():
        fields[own] = _field(type_, ..., meanings.get(own, own), where.of(own))
    for own in fields:
        if hasattr(Message, own) or own.startswith("_"):
            raise where.error(f"a parameter cannot be called {own!r}")
    summary, description = _words(function)
    request = _model(f"{stem}Request", Message, summary, fields)
    result = hints.get("return", ...) if mark.result is None else mark.result
    answer, output = _answer(result, mark.output, f"{stem}Answer", summary, where)

    def invoke(instance: Any, given: Message, call: Call) -> Any:
        values = {own: getattr(given, own) for own in fields}
        if call_name:
            values[call_name] = call
        return function(instance, **values)

    effect = _effect(service, mark, bool(call_name), where)
    return Method(name, summary, description, mark.scope, effect, request, answer, output, invoke)


def _effect(service: type[Service], mark: Mark, takes_call: bool, where: _Where) -> Effect:
    """Return the declared effect; a method that has no way to write needs no declaration."""
    if mark.effect is not None:
        if mark.effect not in EFFECTS:
            raise where.error(f"effect {mark.effect!r}; expected one of {', '.join(EFFECTS)}")
        return mark.effect
    needs = (need for _, need in own_attributes(service) if isinstance(need, ResourceNeed))
    if mark.scope != "read" or takes_call or any(need.writable for need in needs):
        raise where.error(
            "it could write; say what it does: @method(effect='reads'), 'records' or 'writes'"
        )
    return "reads"


def _answer(
    result: Any, output: str, name: str, summary: str, where: _Where
) -> tuple[type[Answer], str]:
    if result is ...:
        raise where.error("the result has no annotation")
    if result in (None, type(None)):
        return _model(name, Answer, summary, {}), ""
    if isinstance(result, type) and issubclass(result, Answer):
        return result, ""
    if not output.isidentifier() or hasattr(Answer, output):
        raise where.error(f"the output cannot be called {output!r}")
    fields = {output: _field(result, ..., "", where.of("result"))}
    return _model(name, Answer, summary, fields), output


def _field(annotation: Any, default: Any, meaning: str, where: _Where) -> tuple[Any, Any]:
    if meaning:
        return _sent(annotation, where), Field(default, description=meaning)
    return _sent(annotation, where), Field(default)


def _sent(annotation: Any, where: _Where) -> Any:
    """Return the type of a field for an annotation; plain types read as those of messages do."""
    if annotation in _PLAIN:
        return _PLAIN[annotation]
    origin, arguments = typing.get_origin(annotation), typing.get_args(annotation)
    if origin is Annotated:
        if any(isinstance(argument, Carried) for argument in arguments):
            return annotation
        return Annotated[(_sent(arguments[0], where), *arguments[1:])]
    if origin is list:
        return list[_sent(arguments[0], where)]  # type: ignore[misc]  # made while running
    if origin in (types.UnionType, typing.Union):
        kinds = [argument for argument in arguments if argument is not type(None)]
        if len(kinds) == 1:
            return _sent(kinds[0], where) | None
    if origin in (Literal, dict) or annotation is dict:
        return annotation
    if isinstance(annotation, type) and issubclass(annotation, BaseModel):
        return annotation
    raise where.error(
        f"{annotation!r} cannot be sent; use float, int, bool, str, bytes, lists of "
        "these, the types of rtask.wire.types, a Message or an Answer"
    )


def _hints(function: Any, where: _Where) -> dict[str, Any]:
    try:
        return typing.get_type_hints(function, localns={"Call": Call}, include_extras=True)
    except NameError as error:
        raise where.error(f"{error}; annotations are read when a service loads") from None


def _words(declared: Any) -> tuple[str, str]:
    """Return the first line of a docstring, and its rest up to the list of parameters."""
    text = inspect.cleandoc(declared.__doc__ or "")
    first, _, rest = text.partition("\n")
    return first.rstrip("."), re.split(r"\n\w[\w ]*\n-{3,}\n", "\n" + rest)[0].strip()


def _meanings(text: str) -> dict[str, str]:
    """Return what a numpydoc docstring says of each parameter.

    Examples
    --------
    >>> _meanings('''Move.
    ...
    ... Parameters
    ... ----------
    ... joints : (n,) float, rad
    ...     Angles, from base
    ...     to tip.
    ... arm
    ...     Name.''')
    {'joints': 'Angles, from base to tip', 'arm': 'Name'}
    """
    _, _, rest = ("\n" + text).partition("\nParameters\n----------\n")
    section = re.split(r"\n\w[\w ]*\n-{3,}\n", rest)[0]
    meanings: dict[str, str] = {}
    names: list[str] = []
    for line in section.splitlines():
        if line and not line[0].isspace():
            names = [name_.strip() for name_ in line.partition(" : ")[0].split(",")]
        elif line.strip():
            for name in names:
                meanings[name] = (
                    f"{meanings[name]} {line.strip()}" if name in meanings else line.strip()
                )
    return {name: words.rstrip(".") for name, words in meanings.items()}


def _source(service: type[Service]) -> str:
    """Return where another process finds a class: a module, or the file of a loaded file."""
    file = getattr(sys.modules.get(service.__module__), "__rtask_file__", None)
    return f"{file or service.__module__}:{service.__qualname__}"


def _place(declared: Any) -> str:
    """Return file and line of a class or a function, as far as they are known."""
    try:
        file, (_, line) = inspect.getsourcefile(declared), inspect.getsourcelines(declared)
    except (OSError, TypeError):
        return getattr(declared, "__module__", "service")
    return f"{file}:{line}"
