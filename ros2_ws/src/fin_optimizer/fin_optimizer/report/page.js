"use strict";
(() => {
  const root = document.documentElement;
  const plots = [...document.querySelectorAll(".plot")].map((figure) => ({
    drawing: figure.querySelector(".drawing"),
    given: figure.querySelector("script").textContent,
    isHalf: figure.classList.contains("half"),
    isDrawn: false,
  }));
  const colour = (name) => getComputedStyle(root).getPropertyValue(`--${name}`).trim();
  const told = (text) => {
    const trouble = document.getElementById("trouble");
    trouble.textContent = text;
    trouble.hidden = false;
  };

  // -- plots ---------------------------------------------------------------------------------------------------------

  /** Return a plot's data and layout in the colours that the page has now. */
  function dressed(plot) {
    const figure = JSON.parse(plot.given.replace(/var\(--([a-z0-9]+)\)/g, (_, name) => colour(name)));
    const axis = { gridcolor: colour("grid"), linecolor: colour("line"), zeroline: false, automargin: true };
    const layout = figure.layout;
    for (const name of Object.keys(layout).filter((key) => /^[xy]axis/.test(key))) {
      layout[name] = { ...axis, ...layout[name] };
    }
    const isNarrow = plot.drawing.clientWidth < 420;
    return {
      data: figure.data,
      layout: {
        paper_bgcolor: "rgba(0,0,0,0)",
        plot_bgcolor: "rgba(0,0,0,0)",
        font: { color: colour("ink"), family: "system-ui, 'Segoe UI', 'DejaVu Sans', sans-serif", size: isNarrow ? 11 : 12 },
        margin: { l: 56, r: 16, t: 28, b: 44 },
        hovermode: "closest",
        hoverlabel: { bgcolor: colour("panel"), bordercolor: colour("line"), font: { color: colour("ink") } },
        legend: { orientation: "h", x: 0, y: -62 / (plot.drawing.clientHeight - 74), yanchor: "top" },
        dragmode: matchMedia("(pointer: coarse)").matches ? false : "zoom",
        modebar: { bgcolor: "rgba(0,0,0,0)", color: colour("quiet"), activecolor: colour("ink") },
        ...layout,
        height: plot.drawing.clientHeight,
      },
    };
  }

  function draw(plot, width) {
    const { data, layout } = dressed(plot);
    const bar = matchMedia("(hover: hover)").matches ? "hover" : false;
    const config = { displaylogo: false, displayModeBar: bar, responsive: true, modeBarButtonsToRemove: ["lasso2d", "select2d"] };
    Plotly.react(plot.drawing, data, width ? { ...layout, width, autosize: false } : layout, config);
    plot.isDrawn = true;
  }

  const drawMissing = () => plots.filter((plot) => !plot.isDrawn).forEach((plot) => draw(plot));
  const redraw = () => plots.filter((plot) => plot.isDrawn).forEach((plot) => draw(plot));

  /** Run a script; return whether it could be read. */
  function run(what) {
    const script = Object.assign(document.createElement("script"), what);
    return new Promise((resolve) => {
      script.onload = () => resolve(true);
      script.onerror = () => resolve(false);
      document.head.append(script);
      if (what.textContent !== undefined) resolve(true); // it ran as it was put there
    });
  }

  async function loadPlotly() {
    const bundle = document.getElementById("bundle");
    if (bundle === null) return false;
    if (!("DecompressionStream" in window)) {
      told("This browser is too old to unpack the plots; all tables and numbers are here.");
      return false;
    }
    const packed = await fetch(`data:application/gzip;base64,${bundle.textContent}`);
    const stream = packed.body.pipeThrough(new DecompressionStream("gzip"));
    const file = new Blob([await new Response(stream).arrayBuffer()], { type: "text/javascript" });
    bundle.remove();
    // As a file, which the browser compiles beside the page's own thread; as text where it takes no such file.
    if (!(await run({ src: URL.createObjectURL(file) }))) await run({ textContent: await file.text() });
    return true;
  }

  /** Draw what is seen first, then the rest one by one, so that the page answers at once. */
  async function drawAll() {
    const inView = plots.filter((plot) => plot.drawing.getBoundingClientRect().top < innerHeight);
    inView.forEach((plot) => draw(plot));
    performance.mark("report-open");
    for (const plot of plots) {
      if (!plot.isDrawn) {
        await new Promise((resolve) => setTimeout(resolve));
        if (!plot.isDrawn) draw(plot);
      }
    }
    root.dataset.drawn = "all";
    performance.mark("report-drawn");
  }

  // -- tables --------------------------------------------------------------------------------------------------------

  function value(row, index) {
    const cell = row.cells[index];
    if (cell.dataset.sort !== undefined) return Number(cell.dataset.sort);
    return cell.textContent.trim();
  }

  function compare(a, b) {
    if (typeof a === "number" && typeof b === "number") return a - b;
    return String(a).localeCompare(String(b), "en", { numeric: true });
  }

  function sortBy(head) {
    const body = head.closest("table").tBodies[0];
    const index = head.cellIndex;
    const sign = head.getAttribute("aria-sort") === "ascending" ? -1 : 1;
    const rows = [...body.rows].map((row) => ({ row, key: value(row, index) }));
    // What is not known stays last, whichever way.
    rows.sort((a, b) => (a.key === "") - (b.key === "") || sign * compare(a.key, b.key));
    for (const other of head.parentElement.cells) other.removeAttribute("aria-sort");
    head.setAttribute("aria-sort", sign === 1 ? "ascending" : "descending");
    body.append(...rows.map((each) => each.row));
  }

  for (const head of document.querySelectorAll("th")) head.addEventListener("click", () => sortBy(head));

  // -- the swim ------------------------------------------------------------------------------------------------------

  class Film {
    constructor(figure) {
      this.isPlaying = false;
      this.canvas = figure.querySelector("canvas");
      this.data = JSON.parse(figure.querySelector("script").textContent);
      this.button = figure.querySelector(".play");
      this.slider = figure.querySelector("input");
      this.output = figure.querySelector("output");
      this.slider.max = this.data.frames.length - 1;
      this.frame = 0;
      this.button.addEventListener("click", () => (this.isPlaying ? this.pause() : this.play()));
      this.slider.addEventListener("input", () => {
        this.pause();
        this.show(Number(this.slider.value));
      });
      // Who wants no motion sees the middle of the swim and may play it.
      const isStill = matchMedia("(prefers-reduced-motion: reduce)").matches;
      this.show(isStill ? this.data.frames.length >> 1 : 0);
      if (!isStill) this.play();
    }

    play() {
      this.isPlaying = true;
      this.button.textContent = "pause";
      let last;
      let passed = this.frame;
      const tick = (now) => {
        if (!this.isPlaying) return;
        passed += (Math.max(0, now - (last ?? now)) / 1000) * this.data.rate;
        last = now;
        if (passed >= this.data.frames.length) passed = 0;
        const { top, bottom } = this.canvas.getBoundingClientRect();
        const isSeen = bottom > 0 && top < innerHeight;
        if (isSeen && (Math.floor(passed) !== this.frame || this.frame === 0)) this.show(Math.floor(passed));
        requestAnimationFrame(tick);
      };
      requestAnimationFrame(tick);
    }

    pause() {
      this.isPlaying = false;
      this.button.textContent = "play";
    }

    show(frame) {
      this.frame = frame;
      this.slider.value = frame;
      this.output.textContent = `${(this.data.start + frame / this.data.rate).toFixed(2)} s`;
      const ratio = window.devicePixelRatio || 1;
      const { clientWidth: width, clientHeight: height } = this.canvas;
      if (width === 0) return;
      this.canvas.width = width * ratio;
      this.canvas.height = height * ratio;
      const context = this.canvas.getContext("2d");
      context.scale(ratio, ratio);
      this.draw(context, width, height, this.data.frames[frame]);
    }

    draw(context, width, height, frame) {
      const length = this.data.body[0];
      const reach = Math.max(...this.data.frames[0].slice(3).filter((_, i) => i % 2 === 0).map((x) => Math.abs(x - this.data.frames[0][0])));
      const scale = width / (2.4 * (0.5 * length + reach)); // px a tenth of a millimetre
      const [x0, y0] = frame;
      const at = (x, y) => [width * 0.62 + (x - x0) * scale, height * 0.5 - (y - y0) * scale];
      this.grid(context, width, height, at, x0, y0, scale);
      this.trail(context, at);
      this.tail(context, at, frame, scale);
      this.body(context, at, frame, scale);
      context.fillStyle = colour("quiet");
      context.font = "12px system-ui, sans-serif";
      context.textAlign = "left";
      context.fillText("grid 5 cm", 10, height - 10);
    }

    grid(context, width, height, at, x0, y0, scale) {
      const step = 500;
      context.strokeStyle = colour("grid");
      context.lineWidth = 1;
      context.beginPath();
      const wide = width / scale;
      const high = height / scale;
      for (let x = Math.floor((x0 - wide) / step) * step; x < x0 + wide; x += step) {
        context.moveTo(at(x, 0)[0], 0);
        context.lineTo(at(x, 0)[0], height);
      }
      for (let y = Math.floor((y0 - high) / step) * step; y < y0 + high; y += step) {
        context.moveTo(0, at(0, y)[1]);
        context.lineTo(width, at(0, y)[1]);
      }
      context.stroke();
    }

    /** Draw where the trailing edge has been in the last two beats. */
    trail(context, at) {
      const count = Math.round(this.data.rate * 2 * (this.data.beat || 0.5));
      const points = this.data.frames.slice(Math.max(0, this.frame - count), this.frame + 1).map((each) => each.slice(-2));
      context.strokeStyle = colour("orange");
      context.lineWidth = 1.5;
      context.setLineDash([3, 3]);
      context.beginPath();
      points.forEach(([x, y], index) => (index ? context.lineTo(...at(x, y)) : context.moveTo(...at(x, y))));
      context.stroke();
      context.setLineDash([]);
    }

    tail(context, at, frame, scale) {
      context.lineCap = "round";
      this.data.driven.forEach((isDriven, link) => {
        const [xa, ya, xb, yb] = frame.slice(3 + 2 * link, 7 + 2 * link);
        context.strokeStyle = isDriven ? colour("red") : colour("blue");
        context.lineWidth = Math.max(isDriven ? 4 : 3, 25 * scale);
        context.beginPath();
        context.moveTo(...at(xa, ya));
        context.lineTo(...at(xb, yb));
        context.stroke();
      });
    }

    body(context, at, frame, scale) {
      const [x, y, heading] = frame;
      const [length, width] = this.data.body;
      context.save();
      context.translate(...at(x, y));
      context.rotate(-heading / 1000);
      context.fillStyle = colour("quiet");
      context.beginPath();
      context.ellipse(0, 0, 0.5 * length * scale, 0.5 * width * scale, 0, 0, 2 * Math.PI);
      context.fill();
      context.fillStyle = colour("paper");
      for (const side of [-1, 1]) {
        context.beginPath();
        context.arc(0.36 * length * scale, side * 0.2 * width * scale, Math.max(1.5, 0.012 * length * scale), 0, 2 * Math.PI);
        context.fill();
      }
      context.restore();
    }
  }

  const films = [...document.querySelectorAll(".film")].map((figure) => new Film(figure));
  addEventListener("resize", () => films.forEach((film) => film.show(film.frame)));

  // -- light, dark and paper -----------------------------------------------------------------------------------------

  const WIDTH_ON_PAPER = 700; // px of A4 between its margins
  matchMedia("(prefers-color-scheme: dark)").addEventListener("change", () => {
    if (window.Plotly) redraw();
    films.forEach((film) => film.show(film.frame));
  });
  addEventListener("beforeprint", () => {
    root.classList.add("on-paper");
    films.forEach((film) => film.show(film.frame));
    if (!window.Plotly) return;
    drawMissing();
    plots.forEach((plot) => draw(plot, plot.isHalf ? WIDTH_ON_PAPER / 2 : WIDTH_ON_PAPER));
  });
  addEventListener("afterprint", () => {
    root.classList.remove("on-paper");
    films.forEach((film) => film.show(film.frame));
    if (window.Plotly) redraw();
  });

  loadPlotly().then((isLoaded) => {
    if (isLoaded) return drawAll();
    performance.mark("report-open");
    root.dataset.drawn = "all";
  }).catch((error) => {
    told(`The plots could not be drawn (${error}); all tables and numbers are here.`);
    throw error;
  });
})();
