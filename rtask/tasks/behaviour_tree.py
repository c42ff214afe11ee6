"""Plans as behaviour trees in the XML of BehaviorTree.CPP 4, for others to run."""

from __future__ import annotations

from xml.etree import ElementTree

from rtask.rdf.namespaces import local_name
from rtask.tasks.plan import PlannedStep, TaskPlan

__all__ = ["behaviour_tree"]


def behaviour_tree(plan: TaskPlan) -> str:
    """Return a plan as one sequence of actions, with the parameters of each as ports.

    An action has the local name of its class; a port has the name of a parameter, and its value is
    an IRI.
    """
    root = ElementTree.Element("root", BTCPP_format="4", main_tree_to_execute="Plan")
    tree = ElementTree.SubElement(root, "BehaviorTree", ID="Plan")
    sequence = ElementTree.SubElement(tree, "Sequence", name="; ".join(plan.understood))
    for step in plan.steps:
        ElementTree.SubElement(
            sequence, "Action", {"ID": local_name(step.action), "name": step.text, **step.arguments}
        )
    models = ElementTree.SubElement(root, "TreeNodesModel")
    for step in _of_each_class(plan):
        action = ElementTree.SubElement(models, "Action", ID=local_name(step.action))
        for name in step.arguments:
            ElementTree.SubElement(action, "input_port", name=name, type="std::string")
    ElementTree.indent(root)
    return ElementTree.tostring(root, encoding="unicode", xml_declaration=True) + "\n"


def _of_each_class(plan: TaskPlan) -> list[PlannedStep]:
    classes: dict[str, PlannedStep] = {}
    for step in plan.steps:
        classes.setdefault(step.action, step)
    return list(classes.values())
