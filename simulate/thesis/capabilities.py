"""What both theses promise in words alone: no caption, no figure to hold ours against.

A reader with the book open looks these up as well. An entry names the document, command or test
that shows ours; ``kehoe-capability-surgery`` and its like say why there is nothing.
"""

from __future__ import annotations

from functools import partial

from simulate.thesis.entry import Entry

__all__ = ["ENTRIES"]

_gatto = partial(Entry, "gatto", "capability", state="built")
_kehoe = partial(Entry, "kehoe", "capability", state="built")

ENTRIES = (
    _gatto("other-tasks", "1.1", "an architecture that is easily adapted to other tasks",
           why="`rtask plan` plans with every class of actions in the graph, and one of your own "
           "is an ontology of a few lines and a class: docs/tasks.md"),
    _gatto("ros", "1.4", "ROS as the middleware",
           why="nodes for ROS 1 and 2, and ROS 2 by DDS from outside: docs/ros.md"),
    _gatto("clutter", "2", "things that touch",
           why="`rtask study piles --robot nao` counts picks from piles, "
           "gatto-experiment-success from clutter"),
    _gatto("several-clouds", "2.5.1", "clouds of several cameras as one input",
           why="`rtask segment --also-at`, and segment_views over HTTP: docs/segmentation.md"),
    _gatto("small-objects", "2.5.3, 6", "small clouds, on which the thesis's segmentation fails",
           why="objects of 1.4 to 7 cm beside PCL's: docs/benchmarks/perception.md"),
    _gatto("segmentation-service", "2.6", "segmentation as a topic and as a service",
           why="as rtask/Segmentation by HTTP, rosbridge and agents, and the nodes' topics: "
           "docs/services.md, docs/ros.md"),
    _gatto("descriptors", "2.7", "SIFT and HOG of an object's view",
           why="both are stored with each view: features/recognition/views, docs/recognition.md"),
    _gatto("compression", "3.2.1", "clouds compressed before they are sent",
           why="told in docs/transmission.md; sizes and times in docs/benchmarks/perception.md"),
    _gatto("teacher", "3.2.2", "a teacher links a new view to name and function",
           why="`rtask teach`, page /teach, and teach_object over HTTP: docs/recognition.md"),
    _gatto("tasks", "3.2.3", "tasks that are assigned, timed and made of motions",
           why="`rtask plan --store` assigns steps with their times, and robots claim them: "
           "docs/tasks.md"),
    _gatto("grasp-message", "3.2.4", "the answer as a moveit_msgs/Grasp",
           why="told in docs/ros.md; the round trip that ends with it is gatto-table-4"),
    _gatto("bring-up", "4.3", "the real Nao",
           why="`rtask robot reach --naoqi`; tried on a stand-in for NAOqi alone, "
           "never on a robot: docs/first-hour.md"),
    _gatto("bigger-robots", "6", "bigger robots, such as the UR-10",
           why="`rtask robot add` takes a URDF: docs/any-robot.md; what each arm lifted, the "
           "UR10's among them, is in docs/robots.md"),
    _gatto("group", "6", "a group of robots",
           why="`rtask study sharing` measures what each gains: docs/fleet.md; one plan for a "
           "crew: docs/tasks.md"),
    _gatto("large-scale", "6", "learning at a larger scale",
           why="`rtask study learn` on the outcomes of a hundred objects: "
           "docs/benchmarks/learning.md"),
    _gatto("release", "6", "a release of the code", why="Apache-2.0: docs/licences.md"),
    _kehoe("call-centre", "2.5", "a person whom a stuck robot asks",
           why="`rtask questions`, page /questions: a step is given back with choices and a "
           "picture, and goes on when somebody has answered: docs/tasks.md"),
    _kehoe("printed-parts", "3.7", "trials on printed perturbations of a part",
           state="done differently",
           why="nothing is printed here: 40 simulated parts, perturbed as the planner assumes: "
           "docs/benchmarks/push.md"),
    _kehoe("box2d", "3.8", "the simulator of push grasps",
           why="a quasi-static one of our own; agreement with Box2D and its times: "
           "docs/benchmarks/push.md"),
    _kehoe("object-model", "4.4", "an object's model: cloud, mesh and grasps at an address",
           why="models grow from views, `rtask objects mesh` closes their surface, and "
           "/api/objects gives each its address: docs/pose.md"),
    _kehoe("candidate-grasps", "4.4", "candidate grasps with a quality s_G",
           why="`rtask grasp space` ranks them by chances of holding: docs/grasp-planning.md; "
           "how well the ranks agree with physics: docs/benchmarks/grasp.md"),
    _kehoe("registration", "4.4", "ICP from 72 x 8 starts", state="done differently",
           why="256 rotations that cover all orientations evenly, and a test of free space: "
           "docs/pose.md"),
    _kehoe("outcomes", "4.4", "outcomes of grasps sent back",
           why="report_outcome, and what follows from it for the next robot: docs/learning.md"),
    _kehoe("advantages", "5.4", "twelve advantages of services",
           why="a table with a test for each: docs/services.md"),
    _kehoe("services", "5.5", "services, methods by URL, data sets and pipelines",
           why="all of them: docs/services.md"),
    _kehoe("formats", "5.6", "JSON, BSON, ROS and multipart", state="done differently",
           why="CBOR in the place of BSON, since it has a standard; the others as named: "
           "docs/services.md"),
    _kehoe("web-tools", "5.8", "motion planning and grasping as services",
           why="services rtask/Kinematics, rtask/Trajopt and rtask/Grasping: docs/services.md"),
    _kehoe("uncertain-shape", "6.2", "uncertain shape in three dimensions",
           why="samples of a Gaussian random field on the hull: `rtask grasp space --shapes`, "
           "docs/grasp-planning.md"),
    _kehoe("other-grippers", "6.2", "compliant and many-fingered grippers",
           why="suction cups that yield, and three fingers: docs/other-hands.md"),
    _kehoe("adaptive-sampling", "6.2", "more samples where it matters",
           why="racing stops what cannot win (kehoe-fig-3.15), and the best are refined by "
           "simulation: docs/grasp-planning.md"),
    _kehoe("contributors", "6.2", "dirty data and malicious contributors",
           why="`rtask contributors` compares and withdraws; `rtask study trust` measures what "
           "liars cost: docs/fleet.md, docs/curation.md"),
    _kehoe("anytime", "6.2", "a near and a far answer at once",
           why="`rtask.client.race` asks both, and links are cut in the measurement: "
           "docs/services.md"),
    _kehoe("scaling", "6.2", "more robots than one machine serves",
           why="copies that answer reads, and workers on other machines; one process writes: "
           "docs/stores.md, docs/workers.md"),
    _kehoe("datasets", "6.2", "data sets that are snapped, forked, pruned and merged",
           why="of services: docs/services.md; of the graph, branches: docs/knowledge-base.md; "
           "what robots contradict each other in: docs/curation.md"),
    _kehoe("privacy", "6.2", "private data", state="done differently",
           why="a token reads some graphs alone, and robots, whose work needs the others' "
           "outcomes, read all: docs/security.md"),
    _kehoe("surgery", "6.2", "surgery", state="not applicable", why="no such robot or data here"),
)  # fmt: skip
