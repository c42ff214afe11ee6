// Grasps as files to download.

/** Let the browser save a text. */
export function saveAs(name, type, content) {
  const link = document.createElement("a");
  link.href = URL.createObjectURL(new Blob([content], { type }));
  link.download = name;
  link.click();
  setTimeout(() => URL.revokeObjectURL(link.href), 1000); // the download has begun by then
}

/** Return grasps as CSV, best first; lengths in m. */
export function tableOf(grasps) {
  const head = "rank,contact_x,contact_y,approach_x,approach_y,opening,probability,lower_95";
  const rows = grasps.map((grasp, index) => [
    index + 1, ...grasp.contact, ...grasp.approach, grasp.opening, grasp.probability, grasp.lower_95,
  ].join(","));
  return [head, ...rows, ""].join("\r\n");
}
