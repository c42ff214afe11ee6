"""A program that has an arm follow a long way, to be killed on it."""

from __future__ import annotations

import sys

from tests.simulate.drivers.benches import FAR, NaoqiBench, be_patient, slowly
from tests.simulate.drivers.hostile_arm import ACTION, JOINTS, LIMITS, START, TOPIC


def main():
    be_patient()
    kind, address, *ros = sys.argv[1:]
    if kind == "naoqi":
        from simulate.drivers.naoqi import NaoqiArm

        arm, far = NaoqiBench.arm, NaoqiBench.start.copy()
        far[NaoqiBench.joint] = NaoqiBench.far
        with NaoqiArm(address, arm.joints, "RHand") as driver:
            slowly(driver, NaoqiBench.start, far)
    else:
        from simulate.drivers.rosbridge import RosbridgeArm

        version = 1 if ros == ["1"] else 2
        with RosbridgeArm(address, ACTION, JOINTS, TOPIC, limits=LIMITS, ros=version) as driver:
            slowly(driver, START, FAR)


if __name__ == "__main__":
    main()
