// The state of the page of arms in its address: robot, arm, postures, balls, camera.

export const round = (value) => Number(value.toFixed(4));

/** Return the part of an address that `readAddress` reads. */
export function addressOf({ robot, arm, start, goal, balls }, camera) {
  const joints = (posture) => posture.map(round).join(",");
  const kept = { robot, arm, start: joints(start), goal: joints(goal), balls: balls.map((ball) => ball.join(",")).join(";"), camera: camera.join(",") };
  return new URLSearchParams(kept).toString();
}

/** Return what an address holds; what cannot be read is left out. */
export function readAddress(hash) {
  const kept = new URLSearchParams(hash.slice(1));
  const numbers = (text, count) => {
    const found = (text || "").split(",").map(Number);
    return found.every(Number.isFinite) && (!count || found.length === count) ? found : undefined;
  };
  return {
    robot: kept.get("robot"),
    arm: kept.get("arm"),
    start: numbers(kept.get("start")),
    goal: numbers(kept.get("goal")),
    balls: (kept.get("balls") || "").split(";").filter(Boolean).map((ball) => numbers(ball, 4)).filter(Boolean),
    camera: kept.has("camera") ? numbers(kept.get("camera"), 2) : undefined,
  };
}
