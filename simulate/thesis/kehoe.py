"""Tables, figures, algorithms and experiments of Kehoe 2014."""

from __future__ import annotations

from functools import partial

from simulate.thesis.entry import Entry

__all__ = ["ENTRIES"]

_compared = partial(Entry, "kehoe", state="compared")
_shown = partial(Entry, "kehoe", state="shown")
_ours = partial(Entry, "kehoe", state="done differently")
_none = partial(Entry, "kehoe", state="not applicable")

_OTHERS = "a system of others, in a survey"

ENTRIES = (
    _none("fig", "1.1", "1.1", "robots and the cloud", why="an illustration"),
    _shown("experiment", "collective-learning", "1.2",
           "sharing of control policies and outcomes", run="shared_policy:policies",
           why="a robot finds the policy of another by its environment, uses it and goes on "
           "learning; outcomes, and the belief in each grasp that follows from them, are shared by "
           "all robots (beyond-lessons)"),
    _shown("experiment", "trajectories", "1.2", "sharing of trajectories",
           run="remembered:motions", material="simulated arms that plan",
           why="recall_motions offers the movements of others in the joints of the robot that "
           "asks, and says why it cannot follow the rest: docs/recordings.md"),
    *(
        _none("fig", f"2.{number}", section, shows, why=_OTHERS)
        for number, section, shows in (
            (1, "2.2", "RoboEarth"), (2, "2.2", "data from many sources"),
            (3, "2.2", "Google's object recognition"), (5, "2.4", "cooperative mapping"),
            (6, "2.4", "sampling-based planning on many nodes"), (7, "2.4", "CloudThink"),
            (9, "2.5", "tiered human assistance"),
            (10, "2.5", "crowdsourced identification"), (11, "2.6", "a cheap robot"),
            (12, "2.6", "CloudSim"),
        )
    ),
    _shown("fig", "2.8", "2.4", "Lightning: paths from experience", run="remembered:paths",
           why="a system of others, in a survey; ours tries recalled paths and new ones by turns"),
    _shown("fig", "2.4", "2.3", "grasping under uncertain shape, as in chapter 3",
           run="push_figures:tolerance_model"),
    _shown("fig", "3.1", "3.1", "the tolerance model and its results",
           run="push_figures:tolerance_model"),
    _ours("fig", "3.2", "3.3", "contact configurations",
          why="codes of grasp.push.trials, explained in docs/grasp-planning.md"),
    _ours("fig", "3.3", "3.3", "snapshots of a push grasp",
          why="`rtask grasp push --save-plots` draws the jaws; for the arm see kehoe-fig-3.21"),
    _ours("fig", "3.4", "3.4", "pushes that fail",
          why="codes of grasp.push.trials, explained in docs/grasp-planning.md"),
    _ours("fig", "3.5", "3.4", "configuration space for fast analysis",
          why="grasp.push.mechanics computes the same bounds in closed form, without the map"),
    _ours("fig", "3.6", "3.4", "modes of force closure",
          why="slip and friction closure are codes of grasp.push.trials"),
    _shown("fig", "3.7", "3.4", "filtering a noisy outline", run="push_figures:filtering"),
    _compared("algorithm", "1", "3.4", "analysis of grasps", run="push_tables:table_3_1",
              why="what it computes is Table 3.1"),
    _compared("algorithm", "2", "3.4", "planning of grasps", run="push_figures:best_grasps",
              why="what it returns is Figure 3.8"),
    _compared("fig", "3.8", "3.5", "best grasps of the brackets", run="push_figures:best_grasps"),
    _compared("fig", "3.9", "3.5", "whiskers of Part A", run="push_figures:part_a"),
    _compared("table", "3.1", "3.5", "Q* and run time", run="push_tables:table_3_1"),
    _compared("fig", "3.10", "3.5", "whiskers of Part B", run="push_figures:part_b"),
    _compared("experiment", "nominal", "3.5", "planning without uncertainty",
              run="push_tables:nominal"),
    _shown("experiment", "sensitivity", "3.5", "84 settings of the candidates",
           run="push_tables:sensitivity"),
    _compared("fig", "3.11", "3.5", "Q* against perturbations", run="push_figures:convergence"),
    _compared("fig", "3.12", "3.5", "tolerances of four parts", run="push_figures:tolerancing"),
    _compared("fig", "3.13", "3.5", "quality as tolerances rise", run="push_figures:tolerancing"),
    _shown("fig", "3.14", "3.5", "candidates that are eliminated", run="push_figures:eliminated"),
    _compared("fig", "3.15", "3.5", "quality against time, elimination",
              run="push_figures:elimination"),
    _compared("fig", "3.16", "3.5", "worst case of elimination", run="push_figures:elimination"),
    _compared("fig", "3.17", "3.6", "speed-up of the average node", run="push_nodes:speed_up"),
    _compared("fig", "3.18", "3.6", "speed-up of the slowest node", run="push_nodes:speed_up"),
    _compared("fig", "3.19", "3.6", "speed-up with start-up", run="push_nodes:speed_up"),
    _compared("table", "3.2", "3.6", "variation of running times", run="push_nodes:table_3_2"),
    _compared("experiment", "early-shards", "3.6", "ending with the nodes that finish first",
              run="push_nodes:early_shards"),
    _none("fig", "3.20", "3.7", "the set-up for Object M",
          why="a photograph of a Zymark robot; ours is a simulated Panda, see kehoe-fig-3.21"),
    _compared("fig", "3.21", "3.7", "three grasps of Object M", run="push_pose:object_m"),
    _compared("experiment", "third-grasp", "3.7", "why the third grasp of Object M fails or holds",
              run="push_pose:third_grasp"),
    _compared("fig", "3.22", "3.8", "one grasp at two poses", run="push_pose:pose_uncertainty"),
    _compared("fig", "3.23", "3.8", "quality under uncertain pose",
              run="push_pose:pose_uncertainty"),
    _none("fig", "4.1", "4.1", "the PR2 at work", why="a photograph; no PR2 here"),
    _ours("fig", "4.2", "4.3", "architecture, offline phase",
          why="teach_object stores views, model and grasps: docs/recognition.md"),
    _ours("fig", "4.3", "4.3", "architecture, online phase",
          why="recognise_for_grasp answers object, pose and grasp at once: docs/engine.md"),
    _ours("fig", "4.4", "4.4", "a photo recognised from a phone",
          why="`rtask recognise PHOTO`, or search_object over HTTP, from any device"),
    _shown("experiment", "stored-images", "4.4", "training and asking with images over HTTP",
           run="images:stored_images",
           why="fields `view` and `picture` of search_object: docs/engine.md"),
    _none("fig", "4.5", "4.5", "the six objects",
          why="a photograph; kehoe-fig-4.6 and gatto-fig-5 show our stand-ins"),
    _compared("table", "4.1", "4.5", "recall by training set", run="recognition:table_4_1"),
    _compared("fig", "4.6", "4.5", "images that are not identified",
              run="recognition:not_identified"),
    _compared("table", "4.2", "4.5", "failures of the pose", run="poses:table_4_2"),
    _compared("table", "4.3", "4.5", "failures of grasps", run="poses:table_4_3"),
    _none("fig", "4.7", "4.6", "the hundred objects",
          why="a picture of an unpublished data set; ours are products of the simulator"),
    _compared("fig", "4.8", "4.6", "recall by share of stored views", run="recognition:curves"),
    _compared("fig", "4.9", "4.6", "wrong answers by share of stored views",
              run="recognition:curves"),
    _compared("fig", "4.10", "4.6", "examples of wrong answers", run="recognition:curves",
              why="their number is in Figure 4.9"),
    _compared("experiment", "confidences", "4.6", "confidences of right and wrong answers",
              run="recognition:confidences"),
    _compared("experiment", "axis", "4.6", "the check of principal axes", run="poses:axis"),
    _ours("fig", "5.1", "5.1", "an application of the website",
          why="pages /setup and /tools/pipeline: docs/services.md"),
    _ours("fig", "5.2", "5.2", "platform and service as flowcharts",
          why="a class becomes a service by its entry point: docs/services.md"),
    _ours("fig", "5.3", "5.6", "architecture of Brass",
          why="queues and pipelines of rtask.services, and workers that start and stop by load, as "
          "processes or containers: docs/workers.md"),
    _ours("fig", "5.4", "5.8", "web application for motion planning", why="page /tools/arm"),
    _ours("fig", "5.5", "5.8", "web application for grasping", why="page /tools/grasp"),
    _ours("listing", "kinematics", "5.7", "a service in code",
          why="tests/rtask/services/listing runs it, but for its lines of OpenRAVE"),
    _ours("experiment", "asking", "6.2", "cost of asking against cost of failure",
          why="`rtask study asking-price` measures what weighing the two saves: docs/tasks.md"),
    _shown("experiment", "shared-environment", "6.2", "a copy, a simulated task, and back",
           run="environment:shared_environment",
           why="branches of the graph: docs/knowledge-base.md"),
    _shown("experiment", "belief", "6.2", "tolerance against cost", run="push_tables:belief"),
)  # fmt: skip
