"""A stand-in for rosbridge before an arm that lies."""

from __future__ import annotations

import json
import threading
import time

from websockets.exceptions import ConnectionClosed
from websockets.sync.server import serve

from tests.simulate.drivers.hostile_arm import ACTION, TOPIC, HostileArm


class HostileBridge(HostileArm):
    """A stand-in for rosbridge before an arm of two joints; ``state`` and ``end`` say how it lies.

    It speaks the protocol of rosbridge 2.x: ``subscribe``, ``publish``, ``send_action_goal``,
    ``action_result`` with ``result: true`` for every ended goal, and ``cancel_action_goal``; with
    ``ros`` 1 that of the bridge of ROS 1, which has no actions, but actionlib's topics.
    """

    def __init__(self):
        super().__init__()
        self.server = serve(self.session, "127.0.0.1", 0, compression=None)
        self.url = f"ws://127.0.0.1:{self.server.socket.getsockname()[1]}"
        self.thread = threading.Thread(target=self.server.serve_forever)
        self.thread.start()

    def reset(self):
        super().reset()
        self.ros, self.sessions, self.is_cut = 2, 0, False

    def close(self):
        super().close()
        self.server.shutdown()
        self.thread.join()

    def session(self, socket):
        publishes = False
        self.sessions += 1
        try:
            while not self.is_cut:
                try:
                    message = json.loads(socket.recv(timeout=0.01))
                except TimeoutError:
                    message = {}
                op, topic = message.get("op", ""), message.get("topic", "")
                if op in ("subscribe", "unsubscribe") and topic == TOPIC:
                    publishes = op == "subscribe"
                for _ in range(10 if "a second" in self.state else 1):
                    if publishes and self.state != "none":
                        state = self.joint_state()
                        topic = (
                            TOPIC.lstrip("/") if self.state == "a topic without slash" else TOPIC
                        )
                        socket.send(json.dumps({"op": "publish", "topic": topic, "msg": state}))
                cancel, goal = self.understood(message)
                if cancel is not None:
                    self.cancel(cancel)
                if goal is not None and self.begin(socket, *goal):
                    return
                while self.over:
                    self.tell_end(socket, self.over.pop())
                if self.end == "feedback" and self.goals:
                    socket.send(json.dumps(self.feedback(self.goals[-1])))
        except ConnectionClosed:
            return

    def understood(self, message):
        """Return the id of a goal to cancel, and the id and the points of a new one."""
        op, topic, about = message.get("op"), message.get("topic"), message.get("msg")
        if self.ros == 2:
            args = message.get("args")
            cancel = message["id"] if op == "cancel_action_goal" else None
            new = op == "send_action_goal" and (message["id"], args["trajectory"]["points"])
            return cancel, new or None
        assert op not in ("send_action_goal", "cancel_action_goal")
        if op == "publish" and topic == f"{ACTION}/cancel":
            assert about["stamp"] == {"secs": 0, "nsecs": 0}
            return about["id"], None
        if op == "publish" and topic == f"{ACTION}/goal":
            return None, (about["goal_id"]["id"], about["goal"]["trajectory"]["points"])
        return None, None

    def begin(self, socket, goal, points):
        """Carry out a goal; return whether the link is lost over it."""
        if not isinstance(self.end, str) and "at once" in self.end:
            self.take(goal, points)
            socket.send(json.dumps(self.result(goal)))
            return False
        if self.take(goal, points):
            for at in self.end.get("passes", []):
                state = {**self.joint_state(), "position": at}
                socket.send(json.dumps({"op": "publish", "topic": TOPIC, "msg": state}))
                time.sleep(0.1)  # no arm goes there and back within milliseconds
            socket.send(json.dumps(self.result(self.end.get("of", goal))))
            if "then" in self.end:
                socket.send(json.dumps(self.result(goal, self.end["then"])))
        return self.end == "lost"

    def tell_end(self, socket, goal):
        if "at once" not in self.end:
            for _ in range(self.end.get("times", 1)):
                socket.send(json.dumps(self.result(goal)))

    def feedback(self, goal):
        """Return how far a goal is, with all the words that its end has."""
        values = {"error_code": 0, "error_string": "", "desired": {"positions": self.at.tolist()}}
        if self.ros == 1:
            status = {"goal_id": {"id": goal}, "status": 3, "text": "so it is"}
            topic = {"op": "publish", "topic": f"{ACTION}/feedback"}
            return {**topic, "msg": {"status": status, "feedback": values}}
        return {"op": "action_feedback", "id": goal, "action": ACTION, "values": values,
                "status": 4, "result": True}  # fmt: skip

    def result(self, goal, end=None):
        end = self.end if end is None else end
        values = {"error_code": end.get("code", 0), "error_string": ""}
        if self.ros == 1:
            status = {"goal_id": {"id": goal}, "status": end.get("status"), "text": "so it is"}
            topic = {"op": "publish", "topic": f"{end.get('slash', '')}{ACTION}/result"}
            return {**topic, "msg": {"status": status, "result": values}}
        status = {"status": end["status"]} if "status" in end else {}
        about = {"op": "action_result", "id": goal, "action": ACTION, "values": values}
        return {**about, "result": end.get("result", True), **status}
