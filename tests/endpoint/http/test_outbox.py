"""The queue towards a robot is bounded, and answers in it are never dropped."""

from __future__ import annotations

import asyncio

from endpoint.http.websocket import MAX_MESSAGES, Outbox


def test_texts_come_out_in_order_from_any_thread() -> None:
    async def scenario() -> list[str]:
        box = Outbox(asyncio.get_running_loop())
        await asyncio.to_thread(box.put, "a")
        await asyncio.to_thread(box.put, "b", "/t")
        return [await box.take(), await box.take()]

    assert asyncio.run(scenario()) == ["a", "b"]


def test_the_oldest_message_of_a_topic_goes_when_a_robot_reads_too_slowly() -> None:
    async def scenario() -> tuple[list[str], int]:
        box = Outbox(asyncio.get_running_loop())
        for number in range(MAX_MESSAGES + 3):
            box.put(str(number), "/t")
        await asyncio.sleep(0)
        return [await box.take() for _ in range(MAX_MESSAGES)], box.dropped

    texts, dropped = asyncio.run(scenario())
    assert dropped == 3
    assert texts[0] == "3"
    assert texts[-1] == str(MAX_MESSAGES + 2)


def test_answers_are_kept_and_stop_the_reading_until_there_is_room() -> None:
    async def scenario() -> tuple[bool, bool, int]:
        box = Outbox(asyncio.get_running_loop())
        for number in range(MAX_MESSAGES + 2):
            box.put(str(number))
        await asyncio.sleep(0)
        waiting = asyncio.create_task(box.wait_for_room())
        await asyncio.sleep(0)
        before = waiting.done()
        for _ in range(3):
            await box.take()
        await asyncio.sleep(0)
        return before, waiting.done(), box.dropped

    assert asyncio.run(scenario()) == (False, True, 0)


def test_a_closed_box_takes_nothing_and_lets_waiters_go() -> None:
    async def scenario() -> bool:
        box = Outbox(asyncio.get_running_loop())
        box.close()
        box.put("late")
        await asyncio.wait_for(box.wait_for_room(), 1)
        task = asyncio.create_task(box.take())
        await asyncio.sleep(0.01)
        done = task.done()
        task.cancel()
        return done

    assert asyncio.run(scenario()) is False
