// The page at the tank. It shows what the server tells, and tells the server what is pressed. Nothing is kept here:
// what has not come for a second is not shown as live.

const LOST_AFTER = 900; // ms without a word from the server, which speaks five times a second
const RETRY = 500; // ms between two attempts to connect
const PATIENCE = 3000; // ms for an attempt
const CALM = 1100; // ms for which a button is shown before it can be pressed; the server insists on 1000
const HOLD = 800; // ms for which some buttons are held down
const STOP_PATIENCE = 1000; // ms for an answer to the emergency stop
const STOP_AGAIN = 600_000; // ms for which a stop that nobody heard is sent again when the connection is back
const TRACE = 30_000; // ms of the speed's trace
const FRAME_AGE = 1000; // ms after which a picture of the fish is old

const at = (id) => document.getElementById(id);
const clock = () => new Date().toLocaleTimeString([], { hour12: false });
const colour = (name) => getComputedStyle(document.documentElement).getPropertyValue(name).trim();
const SWITCH = "The robot may still move: use the switch of its servos.";

let socket = null;
let attempt = 0;
let session = "";
let me = 0;
let heardAt = -Infinity;
let heardClock = "";
let whyNot = "Connecting to the page's server.";
let snapshot = null;
let frame = null;
let frameAt = -Infinity;
let search = { scores: [], best: [], trials: 0, label: "" };
let trace = [];
let press = null; // of the emergency stop on this page: when, sent at once or late, what was told of a stop before
let shownKeys = "";

// -- the connection ---------------------------------------------------------------------------------------------------

function connect() {
  attempt = performance.now();
  const scheme = location.protocol === "https:" ? "wss:" : "ws:";
  const own = new WebSocket(`${scheme}//${location.host}/socket`);
  let known = false;
  socket = own;
  own.onmessage = (event) => {
    if (socket !== own) return;
    known = true;
    take(JSON.parse(event.data));
  };
  own.onclose = () => {
    if (socket !== own) return;
    socket = null;
    shownKeys = "";
    if (!known) askWhy();
  };
}

function drop() {
  const silent = socket;
  socket = null;
  shownKeys = "";
  silent.close();
  askWhy();
}

async function askWhy() {
  try {
    const answer = await fetch("/", { cache: "no-store" });
    whyNot = answer.ok ? "The page's server does not answer." : (await answer.text()).trim();
  } catch {
    whyNot = "The page's server is not reached: it has ended, or there is no network.";
  }
}

function tell(message) {
  if (socket?.readyState !== WebSocket.OPEN) return false;
  socket.send(JSON.stringify(message));
  return true;
}

function take(told) {
  if (told.kind === "hello") {
    const unheard = press && !press.heard && performance.now() - press.at < STOP_AGAIN;
    if (session && session !== told.session) { // another server: this page is an old one
      if (unheard) sessionStorage.setItem("stop", String(Date.now() - (performance.now() - press.at)));
      location.reload();
      return;
    }
    session = told.session;
    me = told.you;
    whyNot = "Nothing comes from the page's server any more.";
    const before = Number(sessionStorage.getItem("stop")); // pressed before the page was loaded anew
    sessionStorage.removeItem("stop");
    if (unheard) stop(press.at);
    else if (before) stop(performance.now() - (Date.now() - before));
    tell({ do: "look", on: !document.hidden });
  } else if (told.kind === "snapshot") {
    snapshot = told;
    heardAt = performance.now();
    heardClock = clock();
    show();
  } else if (told.kind === "frame") {
    frame = told;
    frameAt = performance.now();
    trace.push([frameAt, told.speed, snapshot?.plant.state === "SWIMMING"]);
    requestAnimationFrame(drawSwim);
  } else if (told.kind === "search") {
    search = told;
    say("search-label", search.scores.length ? [search.label, ...legend()].join("; ") : "");
    drawSearch();
  } else if (told.kind === "pages") {
    const others = told.pages.filter((page) => page.number !== me).map((page) => page.address);
    say("pages", others.length ? `also open at ${others.join(", ")}` : "");
  } else if (told.kind === "answer") {
    say("answer", told.text);
    at("answer").className = told.good ? "" : "bad";
  }
}

const connected = () => performance.now() - heardAt <= LOST_AFTER;
const lost = () => !connected() || !snapshot || snapshot.graph.lost;

setInterval(() => {
  const now = performance.now();
  if (!socket && now - attempt > RETRY) connect();
  // A network that is gone closes no socket: it stays open, and silent.
  if (socket && now - Math.max(attempt, heardAt) > PATIENCE) drop();
  showLost();
  if (now - frameAt > FRAME_AGE) drawSwim();
  showStop();
}, 100);

// -- what is shown ----------------------------------------------------------------------------------------------------

function say(id, text) {
  if (at(id).textContent !== text) at(id).textContent = text;
}

function showLost() {
  const gone = lost();
  const before = document.body.dataset.lost;
  document.body.dataset.lost = gone;
  say("link", gone ? "not live" : "live");
  if (gone) {
    const last = heardClock && !connected() ? ` Last word at ${heardClock}.` : "";
    say("lost-text", (connected() && snapshot ? snapshot.graph.text : `No connection. ${whyNot} ${SWITCH}`) + last);
  }
  if (String(gone) !== before) show();
}

function show() {
  if (!snapshot) return;
  const gone = lost();
  const { plant, study, trial } = snapshot;
  const live = { now: plant.live && !gone, swim: plant.live && !gone, study: study.live && !gone };
  for (const [id, is] of Object.entries(live)) at(id).dataset.live = is;

  say("state", plant.state);
  at("state").className = plant.state;
  say("plant-said", live.now ? "" : plant.said === null ? "" : "last known");
  say("reason", plant.reason);
  say("advice", connected() ? plant.advice : `No connection. ${SWITCH}`);
  say("device", Object.entries(plant.device ?? {}).map(([name, value]) => `${name.replaceAll("_", " ")} ${value}`).join(" · "));
  showTable(plant.mount);

  say("study-text", study.known ? study.text : "No study is heard.");
  say("study-said", live.study || !study.known ? "" : "last known");
  say("mode", study.mode);
  say("folder", study.folder ? `folder ${study.folder.split("/").pop()}` : "");
  at("folder").title = study.folder;
  at("settled").max = Number(study.wanted) || 1;
  at("settled").value = Number(study.settled) || 0;
  say("trial-text", trial.known ? trial.text : "No trial yet.");
  say("unscored", trial.unscored ? `× ${trial.unscored}` : "");
  say("trial-state", [(trial.phase && `now: ${trial.phase}`) || trial.outcome.toLowerCase(), trial.score, trial.reason].filter(Boolean).join(" · "));

  const offers = gone ? [] : snapshot.offers;
  showButtons(at("fish-buttons"), offers.filter((offer) => offer.about === "fish"));
  showButtons(at("study-buttons"), offers.filter((offer) => offer.about === "study"));
  tellSeen(offers);
  showEvents(snapshot.events);
  showStop();
}

function showTable(mount) {
  const rows = Object.entries(mount ?? {});
  at("mount").hidden = !rows.length;
  const text = JSON.stringify(rows);
  if (at("mount").dataset.text === text) return;
  at("mount").dataset.text = text;
  at("mount").tBodies[0].replaceChildren(...rows.map((cells) => {
    const row = document.createElement("tr");
    for (const cell of cells) row.insertCell().textContent = cell;
    return row;
  }));
}

function showEvents(events) {
  const text = JSON.stringify(events);
  if (at("events").dataset.text === text) return;
  at("events").dataset.text = text;
  at("events").replaceChildren(...[...events].reverse().map((event) => {
    const item = document.createElement("li");
    item.className = event.good ? "" : "bad";
    item.textContent = `${event.time.slice(0, 8)} ${event.address} ${event.text}`;
    return item;
  }));
}

// -- buttons ----------------------------------------------------------------------------------------------------------

function tellSeen(offers) {
  const keys = document.hidden ? [] : offers.map((offer) => offer.key);
  if (keys.join() !== shownKeys && tell({ do: "see", keys })) shownKeys = keys.join();
}

function showButtons(place, offers) {
  const wanted = new Map(offers.map((offer) => [offer.key, offer]));
  for (const button of [...place.children]) {
    if (!wanted.delete(button.dataset.key)) button.remove();
  }
  for (const offer of wanted.values()) place.append(newButton(offer));
  // In the order told: "Go on" comes where "Pause" was, and "Repeat" stays in its place under a finger.
  offers.forEach(({ key }, index) => {
    const button = [...place.children].find((each) => each.dataset.key === key);
    if (place.children[index] !== button) place.insertBefore(button, place.children[index]);
  });
}

function newButton(offer) {
  const button = document.createElement("button");
  button.type = "button";
  button.dataset.key = offer.key;
  button.dataset.action = offer.action;
  button.textContent = offer.label;
  button.disabled = true;
  setTimeout(() => { button.disabled = false; }, CALM);
  const send = () => {
    say("answer", "");
    if (!tell({ do: "press", key: offer.key })) take({ kind: "answer", text: "Not sent: no connection.", good: false });
  };
  if (!offer.hold) {
    button.addEventListener("click", send);
    return button;
  }
  const hint = document.createElement("small");
  hint.textContent = "hold it down";
  button.append(hint);
  button.style.setProperty("--hold", `${HOLD}ms`);
  let timer = null;
  const end = () => {
    clearTimeout(timer);
    timer = null;
    button.classList.remove("held");
  };
  const begin = () => {
    if (timer !== null || button.disabled) return;
    button.classList.add("held");
    timer = setTimeout(() => { end(); if (button.isConnected) send(); }, HOLD);
  };
  button.addEventListener("pointerdown", begin);
  for (const kind of ["pointerup", "pointerleave", "pointercancel", "blur", "keyup"]) button.addEventListener(kind, end);
  button.addEventListener("keydown", (event) => { if (event.key === "Enter" && !event.repeat) begin(); });
  button.addEventListener("contextmenu", (event) => event.preventDefault());
  return button;
}

// -- the emergency stop -----------------------------------------------------------------------------------------------

// A stop harms nothing, however late it comes: one that nobody heard is sent again, and says how late. No other button
// is ever sent later than it was pressed.
function stop(pressed = null) {
  const now = performance.now();
  const late = pressed === null ? 0 : Math.max(1, Math.round((now - pressed) / 1000));
  press = { at: pressed ?? now, before: JSON.stringify(snapshot?.stop?.number ?? null), took: "", late };
  press.sent = tell(late ? { do: "stop", late } : { do: "stop" });
  showStop();
}

function showStop() {
  const told = connected() ? snapshot?.stop : null;
  const mine = press && told && JSON.stringify(told.number) !== press.before; // the server knows of this press
  if (mine && told.state === "heard" && !press.heard) {
    const took = Math.round(performance.now() - press.at);
    press.took = press.late ? "" : `on this screen ${took} ms after the touch`;
    press.heard = true;
  }
  let text = "";
  const age = press ? performance.now() - press.at : 0;
  if (press && !press.heard && !connected()) {
    const later = age < STOP_AGAIN ? " It is sent when the connection is back." : " It is not sent any more: press it again.";
    text = `${press.sent ? "NOT HEARD" : "NOT SENT"}, no connection: USE THE SWITCH OF THE SERVOS.${later}`;
  } else if (press && !press.heard && !press.sent) {
    text = `NOT SENT: pressed ${Math.round(age / 60_000)} min ago without a connection. Press it again if it is needed.`;
  } else if (press && !mine && !press.heard) {
    text = age > STOP_PATIENCE ? "NO ANSWER YET: USE THE SWITCH OF THE SERVOS." : "STOP sent ...";
  } else if (told) {
    const from = press ? press.took : `pressed at ${told.address}`;
    text = told.state === "waiting" ? "STOP sent ..." : ["STOP", told.text, from].filter(Boolean).join(" · ");
  }
  say("stop-text", text);
}

at("stop").addEventListener("pointerdown", () => stop());
at("stop").addEventListener("click", (event) => { if (event.detail === 0) stop(); }); // by a key or a screen reader
document.addEventListener("keydown", (event) => {
  if (event.code !== "Space") return;
  event.preventDefault();
  if (!event.repeat) stop();
});
document.addEventListener("visibilitychange", () => {
  tell({ do: "look", on: !document.hidden });
  showLost();
  tellSeen(lost() ? [] : snapshot.offers);
});

// -- pictures ---------------------------------------------------------------------------------------------------------

function canvas(id) {
  const element = at(id);
  element.dataset.height ??= element.getAttribute("height");
  const height = Number(element.dataset.height);
  const width = element.clientWidth;
  const ratio = window.devicePixelRatio || 1;
  element.style.height = `${height}px`;
  if (element.width !== Math.round(width * ratio) || element.height !== Math.round(height * ratio)) {
    element.width = Math.round(width * ratio);
    element.height = Math.round(height * ratio);
  }
  const pen = element.getContext("2d");
  pen.setTransform(ratio, 0, 0, ratio, 0, 0);
  pen.clearRect(0, 0, width, height);
  pen.font = "12px system-ui, sans-serif";
  pen.lineJoin = pen.lineCap = "round";
  return { pen, width, height };
}

function drawSwim() {
  drawFish();
  drawTrace();
}

function drawFish() {
  const { pen, width, height } = canvas("fish");
  const age = performance.now() - frameAt;
  const fresh = age <= FRAME_AGE && !lost();
  at("fish").style.opacity = fresh ? "" : "0.35";
  say("swim-age", frame === null ? "no picture yet" : fresh ? "" : `picture of ${(age / 1000).toFixed(0)} s ago`);
  say("speed", fresh && frame.speed !== null ? (100 * frame.speed).toFixed(2) : "-");
  if (frame === null) return;
  const [x, y, heading, length, breadth] = frame.body;
  const scale = Math.min(width / 0.5, height / 0.22); // pixels a metre: half a metre across a phone
  const centreX = x - 0.05 * Math.cos(heading);
  const centreY = y - 0.05 * Math.sin(heading);
  const px = (a) => width / 2 + (a - centreX) * scale;
  const py = (b) => height / 2 - (b - centreY) * scale;
  pen.strokeStyle = colour("--line");
  pen.lineWidth = 1;
  pen.beginPath();
  const step = 0.1;
  for (let a = Math.ceil((centreX - width / 2 / scale) / step) * step; px(a) < width; a += step) {
    pen.moveTo(px(a), 0);
    pen.lineTo(px(a), height);
  }
  for (let b = Math.ceil((centreY - height / 2 / scale) / step) * step; py(b) > 0; b += step) {
    pen.moveTo(0, py(b));
    pen.lineTo(width, py(b));
  }
  pen.stroke();
  pen.fillStyle = colour("--body");
  pen.beginPath();
  pen.ellipse(px(x), py(y), length / 2 * scale, breadth / 2 * scale, -heading, 0, 2 * Math.PI);
  pen.fill();
  const line = (points, style, thick) => {
    pen.strokeStyle = style;
    pen.lineWidth = thick;
    pen.beginPath();
    points.forEach(([a, b], index) => (index ? pen.lineTo(px(a), py(b)) : pen.moveTo(px(a), py(b))));
    pen.stroke();
  };
  line(frame.tail.slice(frame.driven), colour("--fin"), 4);
  if (frame.driven) line(frame.tail.slice(0, frame.driven + 1), colour("--quiet"), 7);
  pen.fillStyle = colour("--quiet");
  pen.fillText("squares of 10 cm", 6, height - 6);
}

function drawTrace() {
  const now = performance.now();
  trace = trace.filter(([time]) => now - time < TRACE);
  const { pen, width, height } = canvas("trace");
  const known = trace.filter(([, speed]) => speed !== null);
  const swum = known.filter(([, , swims]) => swims);
  // A hand that carries the fish back to its mark is faster than any swim, which would then be a flat line.
  const values = (swum.length ? swum : known).map(([, speed]) => 100 * speed);
  const top = Math.max(1, ...values);
  const bottom = Math.min(0, ...values);
  const left = 34;
  const py = (value) => height - 20 - (value - bottom) / (top - bottom) * (height - 32);
  const px = (time) => width - (now - time) / TRACE * (width - left);
  axis(pen, width, left, py, bottom < -0.3 * top ? [bottom, 0, top] : [0, top]);
  pen.fillText("cm/s over the last 30 s", left, height - 3);
  pen.strokeStyle = colour("--act");
  pen.lineWidth = 2;
  pen.save();
  pen.beginPath();
  pen.rect(left, 0, width - left, height - 16);
  pen.clip();
  pen.beginPath();
  let down = false;
  for (const [time, speed] of trace) {
    if (speed !== null) pen[down ? "lineTo" : "moveTo"](px(time), py(100 * speed));
    down = speed !== null;
  }
  pen.stroke();
  pen.restore();
}

function axis(pen, width, left, py, ticks) {
  pen.strokeStyle = colour("--line");
  pen.fillStyle = colour("--quiet");
  pen.lineWidth = 1;
  for (const tick of ticks) {
    pen.beginPath();
    pen.moveTo(left, py(tick));
    pen.lineTo(width, py(tick));
    pen.stroke();
    pen.fillText(tick.toFixed(Math.abs(tick) < 10 ? 2 : 1), 2, py(tick) + 4);
  }
}

/** What the marks of the search mean, of those that are there. */
function legend() {
  const scored = search.scores.filter(([, score]) => score !== null);
  return [
    scored.length > 1 && "line: best so far",
    scored.some(([, , met]) => !met) && "rings miss a constraint",
    scored.length && scored.length < search.scores.length && "×: no score",
  ].filter(Boolean);
}

function drawSearch() {
  const { pen, width, height } = canvas("search");
  const scored = search.scores.filter(([, score]) => score !== null);
  if (!scored.length) {
    pen.fillStyle = colour("--quiet");
    pen.fillText(search.trials ? "no trial has a score yet" : "no trial has ended yet", 6, height / 2);
    return;
  }
  const values = scored.map(([, score]) => score);
  const low = Math.min(...values);
  const high = Math.max(...values);
  const room = Math.max(0.1 * (high - low), 0.02 * Math.abs(high), 1e-9);
  const first = search.scores[0][0];
  const newest = search.scores.at(-1)[0];
  const last = Math.max(newest, first + 1);
  const left = 38;
  const px = (trial) => left + 6 + (trial - first) / (last - first) * (width - left - 12);
  const py = (value) => height - 24 - (value - low + room) / (high - low + 2 * room) * (height - 30);
  axis(pen, width, left, py, high - low > 0.2 * room ? [low, high] : [high]);
  pen.fillText(first === newest ? `trial ${first}` : `trials ${first} to ${newest}`, left, height - 3);
  pen.strokeStyle = colour("--go");
  pen.lineWidth = 2;
  pen.beginPath();
  let before = null;
  search.scores.forEach(([trial], place) => {
    const best = search.best[place];
    if (best === null) return;
    pen[before === null ? "moveTo" : "lineTo"](px(trial), py(before ?? best));
    pen.lineTo(px(trial), py(best));
    before = best;
  });
  if (before !== null) pen.lineTo(px(last), py(before));
  pen.stroke();
  for (const [trial, score, met] of search.scores) {
    if (score === null) {
      pen.fillStyle = colour("--bad");
      pen.fillText("×", px(trial) - 4, height - 18);
      continue;
    }
    pen.fillStyle = pen.strokeStyle = colour("--fin");
    pen.lineWidth = 1;
    pen.beginPath();
    pen.arc(px(trial), py(score), 3, 0, 2 * Math.PI);
    pen[met ? "fill" : "stroke"]();
  }
}

window.addEventListener("resize", () => { drawSwim(); drawSearch(); });
if (location.search) history.replaceState(null, "", "/"); // the token is in the cookie now
connect();
drawSwim();
drawSearch();
