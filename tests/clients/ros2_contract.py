"""Run the contract of the node for ROS 2 in a sourced ROS 2 shell; see ``ros2/contract.py``.

python3 tests/clients/ros2_contract.py [--rtask COMMAND] [--node COMMAND] [--only PATTERN]
"""

import sys
from pathlib import Path

sys.path.insert(0, str(Path(__file__).resolve().parents[2]))

try:
    from tests.clients.ros2.contract import run_and_exit
except ImportError as error:  # numpy, which the node needs as well
    sys.stdout.write(f"not run: {error} in {sys.executable}; apt-get install python3-numpy\n")
    sys.exit(2)

if __name__ == "__main__":
    run_and_exit()
