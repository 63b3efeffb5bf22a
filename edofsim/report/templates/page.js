// The comparison slider: two pictures of a gallery, one over the other, cut at a divider.
document.querySelectorAll(".compare").forEach((figure) => {
  const gallery = document.getElementById(figure.dataset.gallery);
  const pictures = gallery ? [...gallery.querySelectorAll("img[data-label]")] : [];
  if (pictures.length < 2) return;
  const stage = figure.querySelector(".stage"), range = figure.querySelector("input");
  const sides = ["left", "right"].map((side) => {
    const image = document.createElement("img"), tag = document.createElement("span");
    tag.className = "tag " + side;
    tag.setAttribute("aria-hidden", "true");
    return { side, image, tag, choice: figure.querySelector("select." + side) };
  });
  const grip = document.createElement("span");
  grip.className = "grip";
  stage.append(...sides.map((s) => s.image), ...sides.map((s) => s.tag), grip);
  // Wide as the page, but never taller than the window: the divider is dragged with the whole picture in view.
  const ratio = pictures[0].getAttribute("width") / pictures[0].getAttribute("height");
  stage.style.aspectRatio = ratio;
  figure.style.maxWidth = `max(20rem, calc(86vh * ${ratio}))`;

  const move = (percent) => {
    range.value = Math.min(100, Math.max(0, percent));
    stage.style.setProperty("--at", range.value + "%");
    const at = Math.round(range.value);
    range.setAttribute("aria-valuetext", `${at} % ${sides[0].tag.textContent}, ${100 - at} % ${sides[1].tag.textContent}`);
    sides[0].tag.style.opacity = range.value > 8 ? 1 : 0;
    sides[1].tag.style.opacity = range.value < 92 ? 1 : 0;
  };
  const show = () => {
    for (const { image, tag, choice } of sides) {
      const chosen = pictures[choice.selectedIndex];
      image.src = chosen.src;
      image.alt = chosen.alt;
      tag.textContent = chosen.dataset.label;
    }
    move(range.value);
  };
  for (const { side, choice } of sides) {
    pictures.forEach((picture) => choice.add(new Option(picture.dataset.label)));
    choice.selectedIndex = Math.max(0, pictures.findIndex((p) => p.dataset.label === figure.dataset[side]));
    choice.addEventListener("change", show);
  }
  range.addEventListener("input", () => move(range.value));
  const drag = (event) => {
    const box = stage.getBoundingClientRect();
    move((100 * (event.clientX - box.left)) / box.width);
  };
  stage.addEventListener("pointerdown", (event) => {
    drag(event);
    stage.setPointerCapture(event.pointerId);
  });
  stage.addEventListener("pointermove", (event) => {
    if (stage.hasPointerCapture(event.pointerId)) drag(event);
  });
  figure.hidden = false;
  show();
});

// Printed pages show what is folded on the screen.
addEventListener("beforeprint", () => document.querySelectorAll("details").forEach((d) => (d.open = true)));
