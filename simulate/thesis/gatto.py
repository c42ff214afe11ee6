"""Tables, figures and listings of Gatto 2016."""

from __future__ import annotations

from functools import partial

from simulate.thesis.entry import Entry

__all__ = ["ENTRIES"]

_compared = partial(Entry, "gatto", state="compared")
_shown = partial(Entry, "gatto", state="shown")
_ours = partial(Entry, "gatto", state="done differently")
_none = partial(Entry, "gatto", state="not applicable")

ENTRIES = (
    _compared("table", "1", "4.1", "hardware of the Nao", run="robots:table_1"),
    _compared("table", "2", "5.1", "time to extract features", run="features:table_2"),
    _compared("table", "3", "5.1", "time to match all pairs of images", run="features:table_3"),
    _compared("table", "4", "5.1", "round trip of a retrieval", run="robots:table_4",
              material="simulated products"),
    _compared("table", "5", "5.2", "time to plan and carry out a grasp", run="robots:table_5"),
    _ours("fig", "1", "1.1", "the loop of sense, model and act",
          why="`rtask demo` runs the loop and writes back what came of it; docs/index.md draws it"),
    _ours("fig", "2", "1.1", "the phases of the loop",
          why="the phases are the rooms features, rtask and simulate; README has the map"),
    _none("fig", "3", "1.4", "ROS's logo",
          why="a logo; Noetic and ROS 2 are served, see docs/ros.md"),
    _shown("fig", "4", "1.5", "the Nao with an RGB-D camera in a simulator",
           run="robots:portrait_of_nao"),
    _shown("fig", "5", "2", "objects on the table", run="sense:objects"),
    _none("fig", "6", "2.3", "parts of the Kinect",
          why="a photograph of a product; ours is a simulated camera with a Kinect's noise"),
    _shown("fig", "7", "2.3", "calibrating the camera", run="calibration:calibration",
           why="`rtask camera --estimate` does it with photographs, and `rtask camera` checks it"),
    _shown("fig", "8", "2.4", "the table's points and their hull", run="sense:table_hull"),
    _shown("fig", "9", "2.5.1", "phases of supervoxels", run="sense:supervoxels"),
    _shown("fig", "10", "2.5.3", "phases of the segmentation", run="sense:segmentation"),
    _ours("fig", "11", "2.6", "packages of the sense module",
          why="one room, features/segmentation, offered as a service; no ROS package of its own"),
    _shown("fig", "12", "2.6", "segmentation of simulated clouds", run="sense:segmentation"),
    _shown("fig", "13", "2.7.2", "SIFT keypoints", run="sense:keypoints"),
    _ours("fig", "14", "3.1", "packages of the model module",
          why="rooms rtask, reasoner and grasp/learning"),
    _shown("fig", "15", "3.2.2", "RTASK as an extension of CORA", run="model:ontology",
           material="our ontology"),
    _shown("fig", "16", "3.2.3", "the task in the ontology", run="model:task_properties",
           material="our ontology"),
    _ours("fig", "17", "3.2.4", "the engine in the cloud",
          why="one server for SPARQL, HTTP and websocket over an Oxigraph store: docs/engine.md"),
    _compared("fig", "18", "3.2.4", "the pipeline of a retrieval", run="robots:table_4",
              material="simulated products", why="its times are those of Table 4"),
    _none("fig", "19", "3.3.1", "elements of reinforcement learning", why="a textbook's scheme"),
    _none("fig", "20", "3.3.1", "families of learning methods", why="a textbook's scheme"),
    _shown("fig", "21", "3.3.2", "comparison of learners", run="learners:learners"),
    _shown("fig", "22", "3.3.3", "grasp candidates on a cloud", run="model:candidates"),
    _shown("fig", "23", "3.3.4", "the state of an object", run="model:object_state"),
    _ours("fig", "24", "3.3.4", "four actions by quadrant of the angle",
          why="a learner that `rtask study learn` compares; the default has no quadrants"),
    _shown("fig", "25", "4.1", "the Nao and its parts", run="robots:portrait_of_nao"),
    _compared("fig", "26", "4.1", "joints of the arm", run="robots:arm"),
    _ours("fig", "27", "4.2", "MoveIt's pipeline",
          why="a planner of our own; `rtask robot srdf` and the nodes serve MoveIt"),
    _ours("fig", "28", "4.3", "packages of the act module",
          why="rooms simulate/act, simulate/grasping and simulate/motion"),
    _shown("fig", "29", "4.3", "the test program in the simulator", run="robots:test_program"),
    _shown("fig", "30", "4.3", "where the hand can go", run="robots:workspace"),
    _none("fig", "31", "5.2", "the real Nao before a grasp",
          why="no hardware here; `rtask robot reach --naoqi` is tested on a stand-in only"),
    _shown("experiment", "delay", "3.3.2", "learning with late actuators",
           run="learners:actuator_delay"),
    _shown("experiment", "culling", "3.2.1", "frames that are worth sending",
           run="sense:culling"),
    _shown("experiment", "success", "2, 5", "success over trials, which chapter 5 announces",
           run="success:success"),
    _ours("experiment", "two-sensors", "3.3.3", "grasps from one or two sensors",
          why="segmentation (rtask segment --also-at, segment_views) and grasp.spatial.grasp_plan "
          "take several views with the camera of each"),
    _ours("listing", "messages", "3.2.4", "messages of the websocket",
          why="taken word for word (tests/clients), and declared with types: docs/transmission.md"),
    _ours("listing", "launch", "2.6, 3.1, 4.3", "commands that start the nodes",
          why="`rtask serve`, `rtask simulate ros` and `rtask ros node`"),
)  # fmt: skip
