"""People who help robots, Kehoe 2014, 6.2: what asking costs against what failing costs."""

from __future__ import annotations

from simulate.study.asking.command import asking_study, summary_of
from simulate.thesis.result import Compared, Result, Setting

__all__ = ["asking"]


def asking(setting: Setting) -> Result:
    """What robots save that weigh the price of a question against that of a failure."""
    labs = setting.size(30, 4)
    study = asking_study(labs, setting.seed)
    summary = summary_of(setting.trials(study), study.settings)
    rows = []
    for part in summary["prices"]:
        low, high = part["saved_95"]
        what = f"a question at {part['price']:g}, a failed step at {summary['failing_price']:g}"
        rows += [
            Compared(f"{what}: questions in all labs", float(part["questions"])),
            Compared(f"{what}: saved a lab, against the better of never and always asking",
                     part["saved"], interval=(low, high)),
        ]  # fmt: skip
    return Result(
        tuple(rows),
        (
            "the thesis proposes to weigh the two and gives no figures; `rtask study asking-price` "
            "has the costs of both rules",
            *setting.shrunk("labs", 30, labs),
        ),
    )
