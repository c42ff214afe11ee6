"""Pipelines: calls whose middle results stay on the server (Kehoe 2014, 5.5).

A step's inputs may refer to what earlier steps answered, so that a cloud that one service cut and
another is to recognise crosses no network. Everything that can be checked is, before anything
runs; steps that do not wait for each other run together.
"""

from __future__ import annotations

import concurrent.futures
import time
from collections.abc import Mapping
from typing import Annotated, Any

from annotated_types import Len

from rtask.errors import MissingDataError, RtaskError, UnsupportedError, UsageError, nearest
from rtask.services.builtin.steps import INPUT, REF, Step, interface, ref_of, refs_in
from rtask.services.call import Call
from rtask.services.pipelines import SavedPipelines, Stored
from rtask.services.resources import Resource
from rtask.services.service import Service, method
from rtask.services.task import Task
from rtask.wire.fields import Kind, kind_of
from rtask.wire.fitting import entry_of, kind_at, misfit, words_for
from rtask.wire.message import Answer, Message
from rtask.wire.types import Text

__all__ = ["Piped", "Pipeline", "SavedPipeline", "Step", "carry_out"]

MAX_STEPS, MAX_ITEMS, _AT_ONCE = 32, 256, 8
_ITEM = "item"


class Piped(Answer):
    """Answer of a pipeline: the values that were requested."""

    output: dict[str, Any]
    """values by the names that the request gave them"""
    took_ms: dict[str, float]
    """time of each step, all its calls, waiting included, ms"""


class SavedPipeline(Answer):
    """A pipeline that is a service of its own."""

    name: str
    """of the service; its method is run"""
    version: str
    owner: str | None = None
    """who may change or remove it; null = everybody who may write"""
    summary: str
    steps: list[Step]
    output: dict[str, Any]
    """the values that it answers, by name"""


class Pipeline(Service):
    """Calls of services in one request; middle results stay on the server."""

    name = "rtask/Pipeline"
    version = "1.2.0"
    max_workers = 8
    timeout_s = 600.0

    def __init__(
        self,
        data_resources: Mapping[str, Resource] | None = None,
        saved: SavedPipelines | None = None,
    ) -> None:
        super().__init__(data_resources)
        self.saved = saved

    @method(effect="writes")
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
        values, took_ms = _carried_out(steps, output, given, given, call)
        return Piped(output=values, took_ms=took_ms)

    @method(scope="write", effect="writes")
    def save(
        self,
        pipeline: Text,
        steps: Annotated[list[Step], Len(1, MAX_STEPS)],
        output: Annotated[dict[str, Any], Len(1, MAX_STEPS)],
        call: Call,
        version: Text = "1.0.0",
        summary: Text | None = None,
        defaults: dict[str, Any] | None = None,
    ) -> SavedPipeline:
        """Keep a pipeline as a service, which is called like any other.

        Parameters
        ----------
        pipeline
            Name of the service, <namespace>/<name>.
        steps
            The calls; what `{"$input": "name"}` stands for becomes the request of its method `run`.
        output
            The values of its answer, by name.
        version
            Of the service; what it does under one version never changes.
        summary
            What it is for; default: the calls of its steps.
        defaults
            Values of inputs that callers may leave out; default: none.
        """
        every = [[step.inputs, step.each] for step in steps]
        named = {path: None for kind, path in refs_in([*every, output]) if kind == INPUT}
        plan = _checked(steps, output, named, call)
        methods = {name: call.find(*_called(step)) for name, step in plan.items()}
        described = {
            "name": pipeline,
            "version": version,
            "summary": summary or f"Pipeline of {', '.join(step.call for step in steps)}",
            "timeout_s": self.timeout_s,
            "methods": interface(plan, methods, output, defaults or {}),
        }
        stored = {
            "steps": [step.model_dump(mode="json") for step in steps],
            "output": output,
            "description": described,
        }
        return _saved(self._saved_store().save(stored, call.caller))

    @method
    def saved_pipelines(self) -> list[SavedPipeline]:
        """Saved pipelines, sorted by name and version."""
        return [_saved(pipeline) for pipeline in self._saved_store().listing()]

    @method(output="removed", scope="write", effect="writes")
    def remove(self, pipeline: Text, version: Text, call: Call) -> str:
        """Forget one version of a saved pipeline.

        Parameters
        ----------
        pipeline
            Name of the service.
        version
            Which one.
        """
        self._saved_store().remove(pipeline, version, call.caller)
        return f"{pipeline}@{version}"

    def _saved_store(self) -> SavedPipelines:
        if self.saved is None:
            raise UnsupportedError("pipelines cannot be saved here: connect to a server")
        return self.saved


def carry_out(
    stored: Stored, given: Mapping[str, Any], shown: Mapping[str, Any], call: Call
) -> Any:
    """Return the outputs of a saved pipeline by name.

    Parameters
    ----------
    given, shown
        Its inputs by name, as they were read and as JSON.
    """
    steps = [Step.model_validate(step) for step in stored["steps"]]
    return _carried_out(steps, stored["output"], given, shown, call)[0]


def _carried_out(
    steps: list[Step],
    output: Mapping[str, Any],
    given: Mapping[str, Any],
    shown: Mapping[str, Any],
    call: Call,
) -> tuple[Any, dict[str, float]]:
    """Return the outputs by name, and how long each step took, ms."""
    plan = _checked(steps, output, given, call)
    answers, took_ms = _run(plan, given, call)
    values = {name: _shown(answer) for name, answer in answers.items()}
    return _filled(output, values, shown), took_ms


def _called(step: Step) -> tuple[str, str]:
    """Return the service and the method that a step calls."""
    service, _, name = step.call.rpartition("/")
    return service, name


def _saved(stored: Stored) -> SavedPipeline:
    described = stored["description"]
    return SavedPipeline(
        name=described["name"], version=described["version"], owner=stored["owner"],
        summary=described["summary"], steps=[Step.model_validate(step) for step in stored["steps"]],
        output=stored["output"],
    )  # fmt: skip


def _checked(
    steps: list[Step], output: Mapping[str, Any], given: Mapping[str, Any], call: Call
) -> dict[str, Step]:
    """Return the steps by name after making sure that each can be run.

    Raises
    ------
    UsageError
        A name is taken twice, a reference leads nowhere or to a value of another type, an input
        does not exist or is missing, steps wait for each other.
    """
    plan: dict[str, Step] = {}
    methods: dict[str, Any] = {}
    fields: dict[str, list[str] | None] = {}
    for step in steps:
        if step.id in plan or step.id == _ITEM or "." in step.id:
            raise UsageError(f"step {step.id!r}: expected a name of its own, without a dot")
        method = call.find(*_called(step))
        for own in step.inputs:
            if own not in method.request.wire_names:
                hint = nearest(own, list(method.request.wire_names))
                raise UsageError(f"step {step.id}: {step.call} has no input {own!r}{hint}")
        try:
            call.check_data(_called(step)[0], step.data, "data")
        except MissingDataError as error:
            raise MissingDataError(f"step {step.id}: {error}", **error.details) from error
        plan[step.id], methods[step.id] = step, method
        fields[step.id] = None if step.each is not None else list(method.answer.model_fields)
    for step in steps:
        _checkrefs_in(f"step {step.id}", [step.inputs, step.each], fields, given, bool(step.each))
    _checkrefs_in("output", [output], fields, given, False)
    _check_order(plan)
    answers = {
        name: Kind(methods[name].answer, is_list=step.each is not None)
        for name, step in plan.items()
    }
    for name, step in plan.items():
        request = methods[name].request
        _check_types(step, request, answers)
        for own, field in request.wire_names.items():
            if own not in step.inputs and request.model_fields[field].is_required():
                raise UsageError(f"step {step.id}: {step.call} needs the input {own!r}")
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
            raise UsageError(f"step {step.id}: {name}: {value[REF]} does not fit: {reason}")


def _kind_of_ref(value: Any, answers: Mapping[str, Kind]) -> Kind | None:
    """Return the kind of what a reference stands for; None for values and what is not declared."""
    kind, path = ref_of(value) or ("", "")
    start, _, rest = path.partition(".")
    return kind_at(answers[start], rest) if kind == REF and start in answers else None


def _checkrefs_in(
    where: str,
    values: list[Any],
    fields: Mapping[str, list[str] | None],
    given: Mapping[str, Any],
    has_item: bool,
) -> None:
    for kind, path in refs_in(values):
        start, _, rest = path.partition(".")
        if kind == INPUT:
            if path not in given:
                raise UsageError(f"{where}: there is no input {path!r}{nearest(path, list(given))}")
        elif start == _ITEM and has_item:
            continue
        elif start not in fields:
            raise UsageError(f"{where}: there is no step {start!r}{nearest(start, list(fields))}")
        else:
            names, first = fields[start], rest.partition(".")[0]
            if names is not None and first and first not in names:
                raise UsageError(
                    f"{where}: step {start} answers no {first!r}; it answers {', '.join(names)}"
                )


def _needs(step: Step) -> set[str]:
    """Return the names of the steps that one waits for."""
    paths = (path for kind, path in refs_in([step.inputs, step.each]) if kind == REF)
    return {path.partition(".")[0] for path in paths} - {_ITEM}


def _check_order(plan: Mapping[str, Step]) -> None:
    done: set[str] = set()
    while len(done) < len(plan):
        ready = {name for name, step in plan.items() if _needs(step) <= done} - done
        if not ready:
            stuck = ", ".join(sorted(plan.keys() - done))
            raise UsageError(f"these steps wait for each other: {stuck}")
        done |= ready


def _run(
    plan: Mapping[str, Step], given: Mapping[str, Any], call: Call
) -> tuple[dict[str, Any], dict[str, float]]:
    """Return what each step answered, a list for each entry of a list, and its time, ms."""
    answers: dict[str, Any] = {}
    began: dict[str, float] = {}
    took_ms: dict[str, float] = {}
    todo = dict(plan)
    with concurrent.futures.ThreadPoolExecutor(_AT_ONCE) as threads:
        running: dict[concurrent.futures.Future[Any], str] = {}
        while todo or running:
            for name in [n for n, step in todo.items() if _needs(step) <= answers.keys()]:
                began[name] = time.monotonic()
                running[threads.submit(_step, todo.pop(name), dict(answers), given, call)] = name
            done, _ = concurrent.futures.wait(running, return_when="FIRST_COMPLETED")
            for future in done:
                name = running.pop(future)
                answers[name] = future.result()
                took_ms[name] = 1000 * (time.monotonic() - began[name])
            call.progress(len(answers) / len(plan), f"{len(answers)} of {len(plan)} steps")
    return answers, took_ms


def _step(step: Step, answers: Mapping[str, Any], given: Mapping[str, Any], call: Call) -> Any:
    try:
        if step.each is None:
            return _start(step, answers, given, call).result()
        items = _filled(step.each, answers, given)
        if not isinstance(items, list) or len(items) > MAX_ITEMS:
            raise UsageError(f"each: expected a list of at most {MAX_ITEMS}")
        answers_given: list[Answer] = []
        for start in range(0, len(items), _AT_ONCE):
            some = items[start : start + _AT_ONCE]
            tasks = [
                _start(step, {**answers, _ITEM: item_value}, given, call) for item_value in some
            ]
            answers_given += [task.result() for task in tasks]
        return answers_given
    except RtaskError as error:
        raise type(error)(f"step {step.id}: {error}", **error.details) from error


def _start(step: Step, values: Mapping[str, Any], given: Mapping[str, Any], call: Call) -> Task:
    service, name = _called(step)
    task: Task = call.submit(service, name, _filled(step.inputs, values, given), step.data)
    return task


def _filled(value: Any, values: Mapping[str, Any], given: Mapping[str, Any]) -> Any:
    """Return a value with what its references stand for."""
    reference = ref_of(value)
    if reference is not None:
        kind, path = reference
        return given[path] if kind == INPUT else _at(path, values)
    if isinstance(value, Mapping):
        return {name: _filled(part, values, given) for name, part in value.items()}
    return [_filled(part, values, given) for part in value] if isinstance(value, list) else value


def _at(path: str, values: Mapping[str, Any]) -> Any:
    value: Any = values
    for part in path.split("."):
        try:
            value = value[int(part)] if isinstance(value, list) else value[part]
        except (KeyError, IndexError, TypeError, ValueError):
            raise UsageError(f"there is nothing at {path}: no {part!r}") from None
    return value


def _shown(answer: Any) -> Any:
    """Return an answer as JSON."""
    return [part.as_json() for part in answer] if isinstance(answer, list) else answer.as_json()
