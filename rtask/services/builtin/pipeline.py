"""Pipelines: calls whose middle results stay on the server (Kehoe 2014, 5.5).

A step's inputs may refer to what earlier steps answered, so that a cloud that one service cut and
another is to recognise crosses no network. Everything that can be checked is, before anything
runs; steps that do not wait for each other run together.
"""

from __future__ import annotations

import concurrent.futures
from collections.abc import Iterator, Mapping
from typing import Annotated, Any

from annotated_types import Len
from pydantic import Field

from rtask.errors import RtaskError, UsageError, nearest
from rtask.services.call import Call
from rtask.services.service import Service, method
from rtask.services.task import Task
from rtask.wire.fields import Kind, kind_of
from rtask.wire.fitting import entry_of, kind_at, misfit, words_for
from rtask.wire.message import Answer, Message
from rtask.wire.types import Text

__all__ = ["Piped", "Pipeline", "Step"]

MAX_STEPS, MAX_ITEMS, _AT_ONCE = 32, 256, 8
_REF, _INPUT, _ITEM = "$ref", "$input", "item"


class Step(Message):
    """One call of a pipeline."""

    id: Text
    """name under which other steps refer to the answer"""
    call: Text
    """<namespace>/<name>[@version]/<method>"""
    inputs: dict[str, Any] = Field(default_factory=dict)
    """the request; {"$ref": "step.field"} and {"$input": "name"} stand for values"""
    each: dict[str, Any] | None = None
    """a list to call for each entry of, which is "item" in the inputs; default: one call"""
    data: dict[str, str] | None = None
    """datasets for the data resources; default: none"""


class Piped(Answer):
    """Answer of a pipeline: the values that were requested."""

    output: dict[str, Any]
    """values by the names that the request gave them"""


class Pipeline(Service):
    """Calls of services in one request; middle results stay on the server."""

    name = "rtask/Pipeline"
    version = "1.0.0"
    max_workers = 8
    timeout_s = 600.0

    @method
    def run(
        self,
        steps: Annotated[list[Step], Len(1, MAX_STEPS)],
        output: dict[str, Any],
        call: Call,
        inputs: dict[str, Any] | None = None,
    ) -> Piped:
        """Carry out steps in the order in which they need each other.

        Parameters
        ----------
        steps
            The calls.
        output
            The values to return, by name; {"$ref": "step"} is a whole answer.
        inputs
            Values that steps take by {"$input": "name"}; default: none.
        """
        given = inputs or {}
        plan = _checked(steps, output, given, call)
        answers = _run(plan, given, call)
        shown = {name: _shown(answer) for name, answer in answers.items()}
        return Piped(output=_filled(output, shown, given))


def _checked(
    steps: list[Step], output: Mapping[str, Any], given: Mapping[str, Any], call: Call
) -> dict[str, Step]:
    """Return the steps by name after making sure that each can be run.

    Raises
    ------
    UsageError
        A name is taken twice, a reference leads nowhere or to a value of another type, an input
        does not exist, steps wait for each other.
    """
    plan: dict[str, Step] = {}
    methods: dict[str, Any] = {}
    fields: dict[str, list[str] | None] = {}
    for step in steps:
        if step.id in plan or step.id == _ITEM or "." in step.id:
            raise UsageError(f"step {step.id!r}: expected a name of its own, without a dot")
        service, _, name = step.call.rpartition("/")
        found = call.find(service, name)
        for own in step.inputs:
            if own not in found.request.wire_names:
                hint = nearest(own, list(found.request.wire_names))
                raise UsageError(f"step {step.id}: {step.call} has no input {own!r}{hint}")
        plan[step.id], methods[step.id] = step, found
        fields[step.id] = None if step.each is not None else list(found.answer.model_fields)
    for step in steps:
        _check_refs(f"step {step.id}", [step.inputs, step.each], fields, given, bool(step.each))
    _check_refs("output", [output], fields, given, False)
    _check_order(plan)
    answers = {
        name: Kind(methods[name].answer, is_list=step.each is not None)
        for name, step in plan.items()
    }
    for name, step in plan.items():
        _check_types(step, methods[name].request, answers)
    return plan


def _check_types(step: Step, request: type[Message], answers: Mapping[str, Kind]) -> None:
    """Refuse inputs that refer to values of other types, as far as declarations tell."""
    item = None
    if step.each is not None:
        listed = _kind_of_ref(step.each, answers)
        if listed is not None and not listed.is_list:
            raise UsageError(f"step {step.id}: each: {words_for(listed)} is not a list")
        item = listed and entry_of(listed)
    for name, value in step.inputs.items():
        kind = _kind_of_ref(value, answers if item is None else {**answers, _ITEM: item})
        field = request.model_fields[request.wire_names[name]]
        reason = misfit(kind, kind_of(field)) if kind is not None else ""
        if reason:
            raise UsageError(f"step {step.id}: {name}: {value[_REF]} does not fit: {reason}")


def _kind_of_ref(value: Any, answers: Mapping[str, Kind]) -> Kind | None:
    """Return the kind of what a reference stands for; None for values and what is not declared."""
    kind, path = _ref(value) or ("", "")
    start, _, rest = path.partition(".")
    return kind_at(answers[start], rest) if kind == _REF and start in answers else None


def _check_refs(
    where: str,
    values: list[Any],
    fields: Mapping[str, list[str] | None],
    given: Mapping[str, Any],
    has_item: bool,
) -> None:
    for kind, path in _refs(values):
        start, _, rest = path.partition(".")
        if kind == _INPUT:
            if path not in given:
                raise UsageError(f"{where}: there is no input {path!r}{nearest(path, list(given))}")
        elif start == _ITEM and has_item:
            continue
        elif start not in fields:
            raise UsageError(f"{where}: there is no step {start!r}{nearest(start, list(fields))}")
        else:
            known, first = fields[start], rest.partition(".")[0]
            if known is not None and first and first not in known:
                raise UsageError(
                    f"{where}: step {start} answers no {first!r}; it answers {', '.join(known)}"
                )


def _refs(value: Any) -> Iterator[tuple[str, str]]:
    """Yield each reference in a value: its kind and its path."""
    found = _ref(value)
    if found is not None:
        yield found
    elif isinstance(value, Mapping):
        for one in value.values():
            yield from _refs(one)
    elif isinstance(value, list):
        for one in value:
            yield from _refs(one)


def _ref(value: Any) -> tuple[str, str] | None:
    """Return kind and path if a value is itself a reference; other values stand for themselves."""
    if isinstance(value, Mapping) and len(value) == 1:
        kind, path = next(iter(value.items()))
        if kind in (_REF, _INPUT) and isinstance(path, str):
            return kind, path
    return None


def _needs(step: Step) -> set[str]:
    """Return the names of the steps that one waits for."""
    paths = (path for kind, path in _refs([step.inputs, step.each]) if kind == _REF)
    return {path.partition(".")[0] for path in paths} - {_ITEM}


def _check_order(plan: Mapping[str, Step]) -> None:
    done: set[str] = set()
    while len(done) < len(plan):
        ready = {name for name, step in plan.items() if _needs(step) <= done} - done
        if not ready:
            stuck = ", ".join(sorted(plan.keys() - done))
            raise UsageError(f"these steps wait for each other: {stuck}")
        done |= ready


def _run(plan: Mapping[str, Step], given: Mapping[str, Any], call: Call) -> dict[str, Any]:
    """Return what each step answered: an answer, or a list of them for each entry of a list."""
    answers: dict[str, Any] = {}
    todo = dict(plan)
    with concurrent.futures.ThreadPoolExecutor(_AT_ONCE) as threads:
        running: dict[concurrent.futures.Future[Any], str] = {}
        while todo or running:
            for name in [n for n, step in todo.items() if _needs(step) <= answers.keys()]:
                running[threads.submit(_step, todo.pop(name), dict(answers), given, call)] = name
            done, _ = concurrent.futures.wait(running, return_when="FIRST_COMPLETED")
            for one in done:
                answers[running.pop(one)] = one.result()
            call.progress(len(answers) / len(plan), f"{len(answers)} of {len(plan)} steps")
    return answers


def _step(step: Step, answers: Mapping[str, Any], given: Mapping[str, Any], call: Call) -> Any:
    try:
        if step.each is None:
            return _start(step, answers, given, call).result()
        items = _filled(step.each, answers, given)
        if not isinstance(items, list) or len(items) > MAX_ITEMS:
            raise UsageError(f"each: expected a list of at most {MAX_ITEMS}")
        found: list[Answer] = []
        for start in range(0, len(items), _AT_ONCE):
            some = items[start : start + _AT_ONCE]
            tasks = [_start(step, {**answers, _ITEM: one}, given, call) for one in some]
            found += [task.result() for task in tasks]
        return found
    except RtaskError as error:
        raise type(error)(f"step {step.id}: {error}", **error.details) from error


def _start(step: Step, values: Mapping[str, Any], given: Mapping[str, Any], call: Call) -> Task:
    service, _, name = step.call.rpartition("/")
    task: Task = call.submit(service, name, _filled(step.inputs, values, given), step.data)
    return task


def _filled(value: Any, values: Mapping[str, Any], given: Mapping[str, Any]) -> Any:
    """Return a value with what its references stand for."""
    found = _ref(value)
    if found is not None:
        kind, path = found
        return given[path] if kind == _INPUT else _at(path, values)
    if isinstance(value, Mapping):
        return {name: _filled(one, values, given) for name, one in value.items()}
    return [_filled(one, values, given) for one in value] if isinstance(value, list) else value


def _at(path: str, values: Mapping[str, Any]) -> Any:
    found: Any = values
    for part in path.split("."):
        try:
            found = found[int(part)] if isinstance(found, list) else found[part]
        except (KeyError, IndexError, TypeError, ValueError):
            raise UsageError(f"there is nothing at {path}: no {part!r}") from None
    return found


def _shown(answer: Any) -> Any:
    """Return an answer as JSON."""
    return [one.as_json() for one in answer] if isinstance(answer, list) else answer.as_json()
