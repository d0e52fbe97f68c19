"use strict";
(async () => {
  const byId = (id) => document.getElementById(id);
  const data = JSON.parse(byId("data").textContent);
  const [slider, play, now, message, events] = ["time", "play", "now", "message", "events"].map(byId);
  const dark = matchMedia("(prefers-color-scheme: dark)");
  let viewer = null;
  let shown = data.start;
  let wanted = null;
  let playing = null;
  let followed = [0, 0, 0];

  const bytesOf = (id) => Uint8Array.from(atob(byId(id).textContent), (letter) => letter.charCodeAt(0));

  async function library() {
    const inflated = new Blob([bytesOf("library")]).stream().pipeThrough(new DecompressionStream("deflate"));
    const address = URL.createObjectURL(new Blob([await new Response(inflated).arrayBuffer()], { type: "text/javascript" }));
    return new Promise((done, failed) => {
      window.define = (_name, _needs, make) => done(make());
      const script = document.createElement("script");
      script.src = address;
      script.onerror = () => failed(new Error("the viewer of the scene could not be loaded"));
      document.head.append(script);
    });
  }

  function colour() {
    const number = (name) => parseInt(getComputedStyle(document.documentElement).getPropertyValue(name).trim().slice(1), 16);
    viewer.setClearColor(number("--paper"));
    viewer.setLabelColor(number("--faint"));
  }

  function aim() {
    const { clientWidth, clientHeight } = byId("scene");
    const farther = 1 / Math.min(1, clientWidth / clientHeight);
    viewer.setCamera([...data.centre.map((value, axis) => value + farther * data.to_eye[axis]), ...data.centre, 0, 0, 1]);
  }

  function displacement(time) {
    const after = data.path.findIndex(([at]) => at >= time);
    if (after < 1) return (after ? data.path.at(-1) : data.path[0]).slice(1);
    const [[start, ...from], [end, ...to]] = [data.path[after - 1], data.path[after]];
    return from.map((value, axis) => value + (to[axis] - value) * (time - start) / (end - start));
  }

  function follow(time) {
    if (!data.path.length) return;
    const now = displacement(time);
    // K3D's camera: eye, target and upward direction.
    const camera = viewer.getWorld().controls.getCameraArray();
    viewer.setCamera(camera.map((value, i) => i < 6 ? value + now[i % 3] - followed[i % 3] : value));
    followed = now;
  }

  function showTime(time) {
    slider.value = time;
    const phase = data.phases.filter(([start]) => start <= time).pop();
    now.textContent = `${time.toFixed(3)} s${phase ? `  ${phase[1]}` : ""}`;
    for (const line of document.querySelectorAll(".cursor")) {
      const { left, right, start, end } = line.dataset;
      const x = Number(left) + (Number(right) - Number(left)) * (time - Number(start)) / (Number(end) - Number(start));
      line.setAttribute("x1", x);
      line.setAttribute("x2", x);
    }
    let last = null;
    for (const button of events.querySelectorAll("button")) {
      button.parentNode.classList.toggle("now", Math.abs(Number(button.dataset.time) - time) < 1e-9);
      if (Number(button.dataset.time) <= time) last = button;
    }
    if (last) events.scrollTop = last.offsetTop + last.offsetHeight - events.clientHeight;
  }

  async function show(time) {
    wanted = Math.min(Math.max(time, 0), data.end);
    showTime(wanted);
    if (show.busy || !viewer) return;
    show.busy = true;
    while (wanted !== null) {
      const next = wanted;
      wanted = null;
      follow(next);
      await viewer.setTime(data.ticks_per_s * next);
      shown = next;
    }
    show.busy = false;
    requestAnimationFrame(() => requestAnimationFrame(() => { document.documentElement.dataset.shown = shown; }));
  }

  function pause() {
    playing = null;
    play.textContent = "\u25b6";
    play.setAttribute("aria-label", "Play");
  }

  function run() {
    playing = { from: Number(slider.value) >= data.end ? 0 : Number(slider.value), since: performance.now() };
    play.textContent = "\u275a\u275a";
    play.setAttribute("aria-label", "Pause");
    requestAnimationFrame(step);
  }

  async function step(moment) {
    if (!playing) return;
    const time = playing.from + Math.max(0, moment - playing.since) / 1000 * Number(byId("speed").value);
    await show(time);
    if (time >= data.end) pause();
    else requestAnimationFrame(step);
  }

  slider.max = data.end;
  for (const time of data.marks) {
    const tick = document.createElement("i");
    tick.style.left = `${100 * time / data.end}%`;
    byId("ticks").append(tick);
  }
  slider.addEventListener("input", () => { pause(); show(Number(slider.value)); });
  events.addEventListener("click", (event) => {
    const button = event.target.closest("button");
    if (button) { pause(); show(Number(button.dataset.time)); }
  });
  byId("speed").addEventListener("change", () => { if (playing) run(); });
  play.addEventListener("click", () => (playing ? pause() : run()));
  showTime(data.start);

  // An open document in a frame holds back the event "load": what waits for it, as chromium --screenshot, sees the scene.
  const drawing = document.createElement("iframe");
  drawing.hidden = true;
  document.body.append(drawing);
  drawing.contentDocument.open();
  try {
    const k3d = await library();
    viewer = await k3d.CreateK3DAndLoadBinarySnapshot(bytesOf("snapshot"), byId("scene"));
    message.textContent = "";
    colour();
    dark.addEventListener("change", colour);
    aim();
    await show(data.start);
  } catch (fault) {
    message.textContent = `The scene cannot be drawn here: ${fault.message || fault}. Tables and plots are below.`;
    console.error(fault);
  } finally {
    drawing.contentDocument.close();
    drawing.remove();
  }
})();
