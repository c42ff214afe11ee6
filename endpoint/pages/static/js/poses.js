// Poses as people type them: x, y, z in m; roll, pitch, yaw in degrees. No kinematics.

const DEGREES = 180 / Math.PI;

/** Return [x, y, z, roll, pitch, yaw] of a geometry_msgs/Pose. */
export function numbersOf({ position: p, orientation: q }) {
  const roll = Math.atan2(2 * (q.w * q.x + q.y * q.z), 1 - 2 * (q.x ** 2 + q.y ** 2));
  const pitch = Math.asin(Math.min(1, Math.max(-1, 2 * (q.w * q.y - q.z * q.x))));
  const yaw = Math.atan2(2 * (q.w * q.z + q.x * q.y), 1 - 2 * (q.y ** 2 + q.z ** 2));
  return [p.x, p.y, p.z, roll * DEGREES, pitch * DEGREES, yaw * DEGREES];
}

/** Return the geometry_msgs/Pose of [x, y, z, roll, pitch, yaw]. */
export function poseOf([x, y, z, ...angles]) {
  const [[sr, cr], [sp, cp], [sy, cy]] = angles.map((angle) => [Math.sin(angle / DEGREES / 2), Math.cos(angle / DEGREES / 2)]);
  return {
    position: { x, y, z },
    orientation: {
      x: sr * cp * cy - cr * sp * sy, y: cr * sp * cy + sr * cp * sy,
      z: cr * cp * sy - sr * sp * cy, w: cr * cp * cy + sr * sp * sy,
    },
  };
}

/** Return a direction turned by the orientation of a pose. */
export function turned({ orientation: q }, [x, y, z]) {
  const t = [2 * (q.y * z - q.z * y), 2 * (q.z * x - q.x * z), 2 * (q.x * y - q.y * x)];
  return [
    x + q.w * t[0] + q.y * t[2] - q.z * t[1],
    y + q.w * t[1] + q.z * t[0] - q.x * t[2],
    z + q.w * t[2] + q.x * t[1] - q.y * t[0],
  ];
}

/** Return a pose turned where it stands, about an axis of length 1, rad. */
export function spun({ position, orientation: b }, axis, angle) {
  const [s, w] = [Math.sin(angle / 2), Math.cos(angle / 2)];
  const [x, y, z] = axis.map((value) => value * s);
  return {
    position,
    orientation: {
      x: w * b.x + x * b.w + y * b.z - z * b.y, y: w * b.y - x * b.z + y * b.w + z * b.x,
      z: w * b.z + x * b.y - y * b.x + z * b.w, w: w * b.w - x * b.x - y * b.y - z * b.z,
    },
  };
}

export const pointOf = ({ position: { x, y, z } }) => [x, y, z];
