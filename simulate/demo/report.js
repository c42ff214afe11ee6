// Shows one attempt of each robot at a time and moves the hand; without it, all are listed.
for (const row of document.querySelectorAll(".row")) {
  const slide = row.querySelector(".slide");
  const robots = [...row.querySelectorAll(".robot")];
  for (const bar of row.querySelectorAll(".bar")) bar.classList.add("live");
  const show = (number) => {
    for (const robot of robots) {
      const tries = [...robot.querySelectorAll(".tries > li")];
      if (!tries.length) continue;
      const at = Math.min(number, tries.length) - 1;
      tries.forEach((one, index) => { one.hidden = index !== at; });
      robot.querySelector(".bar i").style.width = `${100 * tries[at].dataset.belief}%`;
      move(robot.querySelector(".hand"), tries[at].dataset.hand);
    }
  };
  show(1);
  if (!slide) continue;
  slide.hidden = false;
  const input = slide.querySelector("input");
  input.addEventListener("input", () => {
    slide.querySelector("output").textContent = input.value;
    show(Number(input.value));
  });
}

function move(hand, place) {
  if (!hand || !place) return;
  const [x, y, angle, opening] = place.split(" ").map(Number);
  hand.style.transform = `translate(${x}px, ${y}px) rotate(${angle}deg)`;
  for (const finger of hand.querySelectorAll(".finger")) {
    finger.style.transform = `translate(${finger.dataset.side * opening / 2}px, 0)`;
  }
}
