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

// A slider over pictures, of which one is seen.
document.querySelectorAll(".sweep").forEach((figure) => {
  const pictures = [...figure.querySelectorAll("img")], range = figure.querySelector("input");
  const show = () => {
    pictures.forEach((picture, number) => (picture.hidden = number !== +range.value));
    const label = pictures[range.value].dataset.label;
    figure.querySelector("output").textContent = label;
    range.setAttribute("aria-valuetext", label);
  };
  range.addEventListener("input", show);
  show();
});

// Values under the pointer: the light and the depth that a gallery's pictures hold at a place, at full scale 1.
const pixels = new Map();
const pixelAt = (image, across, down) => {
  if (!pixels.has(image.src)) {
    const canvas = document.createElement("canvas");
    [canvas.width, canvas.height] = [image.naturalWidth, image.naturalHeight];
    const context = canvas.getContext("2d", { willReadFrequently: true });
    context.drawImage(image, 0, 0);
    pixels.set(image.src, context.getImageData(0, 0, canvas.width, canvas.height));
  }
  const found = pixels.get(image.src);
  const x = Math.min(found.width - 1, Math.floor(across * found.width));
  const y = Math.min(found.height - 1, Math.floor(down * found.height));
  return { x, y, rgb: [...found.data.slice(4 * (y * found.width + x), 4 * (y * found.width + x) + 3)] };
};
const linear = (rgb, gain, matrix) => {
  const light = rgb.map((byte) => byte / 255)
    .map((value) => (value <= 0.04045 ? value / 12.92 : ((value + 0.055) / 1.055) ** 2.4) / gain);
  const sensor = [0, 3, 6].map((row) => light.reduce((sum, value, i) => sum + matrix[row + i] * value, 0));
  return sensor.map((value) => value.toFixed(3)).join(" ") + (rgb.some((b) => b % 255 === 0) ? " (clipped)" : "");
};
document.querySelectorAll("img.depth").forEach((depth) => {
  const gallery = depth.closest("figure"), gain = +depth.dataset.gain;
  const matrix = depth.dataset.matrix.split(" ").map(Number);
  const tell = (target, output, shown) => {
    target.addEventListener("pointermove", (event) => {
      const box = target.getBoundingClientRect();
      const across = Math.min(1, Math.max(0, (event.clientX - box.left) / box.width));
      const down = Math.min(1, Math.max(0, (event.clientY - box.top) / box.height));
      const { x, y, rgb } = pixelAt(depth, across, down);
      const dioptres = ((rgb[0] * 256 + rgb[1]) / 65535) * depth.dataset.most;
      const where = rgb[2] ? "no depth" : dioptres > 0 ? `${(1 / dioptres).toPrecision(3)} m` : "infinity";
      const values = shown().map((image) => {
        const light = linear(pixelAt(image, across, down).rgb, gain, matrix);
        return `${image.dataset.label || image.alt} ${light}`;
      });
      output.textContent = `x ${x}, y ${y}, ${where} · ${values.join(" · ")}`;
    });
  };
  const output = (figure) => {
    const made = document.createElement("output");
    made.className = "values";
    made.textContent = "Point at a picture to read the sensor's red, green and blue (full scale 1, from 8 bits).";
    figure.append(made);
    return made;
  };
  const pictures = [...gallery.querySelectorAll("img[data-label]")], all = output(gallery);
  pictures.forEach((picture) => tell(picture, all, () => pictures));
  document.querySelectorAll(`[data-gallery="${gallery.id}"]`).forEach((figure) => {
    const sweep = figure.classList.contains("sweep");
    tell(figure.querySelector(".stage"), output(figure),
      () => (sweep ? [...figure.querySelectorAll("img:not([hidden])")] : pictures));
  });
});

// What the page shows, as files: pictures as PNG, charts as SVG, tables as CSV.
const named = (text) => (document.title + " " + text).toLowerCase().replace(/[^a-z0-9]+/g, "-").replace(/^-|-$/g, "");
const save = (place, name, address) => {
  const link = document.createElement("a");
  link.className = "save";
  link.textContent = "Save";
  link.setAttribute("aria-label", `Save ${name}`);
  link.download = name;
  link.href = "#";
  link.addEventListener("click", () => (link.href = address()));
  place.append(link);
};
document.querySelectorAll(".picture").forEach((picture) => {
  const image = picture.querySelector("img");
  save(picture.querySelector(".name"), named(image.alt.slice(0, 60)) + ".png", () => image.src);
});
document.querySelectorAll(".sweep").forEach((figure) => {
  const seen = () => figure.querySelector("img:not([hidden])");
  save(figure.querySelector(".divider"), named("focused") + ".png", () => seen().src);
});
document.querySelectorAll(".plot").forEach((figure) => {
  const image = figure.querySelector("img");
  save(figure.querySelector("figcaption") || figure, named(image.alt.slice(0, 40)) + ".svg", () => image.src);
});
document.querySelectorAll("table").forEach((table) => {
  const cell = (each) => `"${[...each.childNodes].map((node) => node.textContent).join(" ").replaceAll('"', '""')}"`;
  const rows = [...table.rows].map((row) => [...row.cells].map(cell).join(","));
  const section = table.closest("section");
  save(table.caption || table.createCaption(), named(section ? section.id : "table") + ".csv",
    () => "data:text/csv;charset=utf-8," + encodeURIComponent(rows.join("\r\n")));
});

// Printed pages show what is folded on the screen.
addEventListener("beforeprint", () => document.querySelectorAll("details").forEach((d) => (d.open = true)));
