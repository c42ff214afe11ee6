"""The services that a product offers: built in, installed, and named by its operator."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import replace
from types import ModuleType
from typing import TYPE_CHECKING

from rtask.services.builtin import BUILTIN
from rtask.services.builtin.engine import engine_service
from rtask.services.builtin.pipeline import Pipeline, carry_out
from rtask.services.datasets.store import Datasets
from rtask.services.definition import define
from rtask.services.host import ServiceHost
from rtask.services.ledger import Ledger
from rtask.services.pipelines import SavedPipelines
from rtask.services.registry import imported, installed, services_of

if TYPE_CHECKING:
    from rtask.engine.engine import Engine

__all__ = ["open_host"]


def open_host(engine: Engine | None = None, sources: Iterable[str] = ()) -> ServiceHost:
    """Return a host with all services.

    Its datasets and pipelines are in the folder of the engine's knowledge base, or temporary.

    Parameters
    ----------
    engine
        Whose operations are the service ``rtask/Engine``, and whose graph services may ask.
    sources
        Modules and files of further services, which take the place of others of their names.

    Raises
    ------
    UsageError
        A module or file cannot be loaded, a name with its version is taken, or a version of a
        named source is not what was served under it before.

    Examples
    --------
    >>> with open_host() as host:
    ...     host.registry.find("rtask/Segmentation").exact
    'rtask/Segmentation@1.3.0'
    """
    kb = None if engine is None else engine.kb
    folder = None if kb is None else kb.folder
    pipelines = None if folder is None else folder / "pipelines"
    host = ServiceHost(BUILTIN, kb, Datasets(None if folder is None else folder / "datasets"))
    if engine is not None:
        host.registry.add(engine_service(engine))
    for module in installed():
        _offer(host, module)
    named = [imported(source) for source in sources]
    served = [definition for module in named for definition in services_of(module)]
    try:
        Ledger(None if folder is None else folder / "services.json").check(served)
    except BaseException:
        host.close()
        raise
    for module in named:
        # The operator's own takes the place of what happens to be installed under its name.
        for definition in services_of(module):
            host.registry.forget(definition.name)
    for module in named:
        _offer(host, module)
    saved = SavedPipelines(pipelines, host.registry, carry_out)
    host.registry.replace(replace(define(Pipeline), make=lambda data: Pipeline(data, saved)))
    return host


def _offer(host: ServiceHost, module: ModuleType) -> None:
    """Add the services of a module, and the datasets that come with them."""
    for definition in services_of(module):
        host.registry.add(definition)
    for name, contents in getattr(module, "DATASETS", {}).items():
        host.datasets.offer(name, contents)
