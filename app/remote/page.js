"use strict";
const PERIOD_MS = 1000, STALE_S = 5;
const token = location.hash.slice(1);
const at = (id) => document.getElementById(id);
const show = (id, text) => { at(id).textContent = text; at(id).hidden = !text; };

function fill(list, lines) {
  list.replaceChildren(...lines.map((line) => {
    const item = document.createElement("li");
    item.textContent = line;
    return item;
  }));
}

function ticks(low, high, most) {
  const span = high - low, decade = 10 ** Math.floor(Math.log10(span / most));
  const step = [1, 2, 5, 10].map((m) => m * decade).find((s) => span / s <= most);
  const found = [];
  for (let v = Math.ceil(low / step) * step; v <= high + 1e-9 * span; v += step) found.push(Number(v.toPrecision(12)));
  return found;
}

function draw(data, simulated) {
  const canvas = at("plot"), ratio = window.devicePixelRatio || 1;
  const width = canvas.clientWidth, height = canvas.clientHeight;
  canvas.width = width * ratio;
  canvas.height = height * ratio;
  const pen = canvas.getContext("2d"), style = getComputedStyle(document.documentElement);
  const ink = style.getPropertyValue("--ink"), soft = style.getPropertyValue("--soft"), color = style.getPropertyValue("--data");
  pen.scale(ratio, ratio);
  pen.font = "13px system-ui, sans-serif";
  const points = data.points;
  show("caption", points.length ? `${points.length} points; hollow: not usable` : "Points appear here as they are measured");
  if (!points.length) return;
  const xs = points.map((p) => p[0]), ys = points.map((p) => p[1]);
  let [x0, x1, y0, y1] = [Math.min(...xs), Math.max(...xs), Math.min(0, ...ys), Math.max(...ys)];
  if (x1 === x0) { x0 -= 1; x1 += 1; }
  if (y1 === y0) y1 += 1;
  const pad = 0.04 * (x1 - x0), left = 64, right = width - 12, top = 26, bottom = height - 44;
  const px = (x) => left + (x - x0 + pad) / (x1 - x0 + 2 * pad) * (right - left);
  const py = (y) => bottom - (y - y0) / (1.06 * (y1 - y0)) * (bottom - top);
  pen.strokeStyle = soft;
  pen.fillStyle = ink;
  pen.strokeRect(left, top, right - left, bottom - top);
  pen.textAlign = "center";
  for (const v of ticks(x0, x1, 6)) pen.fillText(String(v), px(v), bottom + 16);
  pen.fillText(data.x, (left + right) / 2, height - 8);
  pen.textAlign = "right";
  for (const v of ticks(y0, y1, 5)) pen.fillText(String(v), left - 6, py(v) + 4);
  pen.textAlign = "left";
  pen.fillText(data.y, 4, 16);
  if (simulated) {
    pen.textAlign = "right";
    pen.fillStyle = "#d0021b";
    pen.fillText("SIMULATED", right, 16);
  }
  pen.strokeStyle = pen.fillStyle = color;
  for (const [x, y, usable] of points) {
    pen.beginPath();
    pen.arc(px(x), py(y), 4, 0, 2 * Math.PI);
    usable ? pen.fill() : pen.stroke();
  }
}

function trouble(text) {
  show("trouble", text);
  at("sign").className = "urgent";
  at("sign").textContent = "no connection";
  show("voltage", "unknown");
  show("note", "this page does not know the bench's state");
}

function render(state) {
  const sign = at("sign"), stale = state.age_s > STALE_S;
  if (stale) {
    trouble("The window has not answered for " + Math.round(state.age_s) + " s: look at the bench.");
  } else {
    sign.textContent = state.state;
    sign.className = state.urgent ? "urgent" : state.live ? "live" : state.state === "at rest" ? "rest" : "";
    show("voltage", state.voltage);
    at("voltage").style.opacity = state.voltage_present ? 1 : 0.6;
    show("note", state.voltage_note);
    show("trouble", state.unsafe || state.problem);
  }
  at("simulated").hidden = !state.simulated;
  show("step", state.next_step);
  at("next").hidden = !state.next_step;
  show("title", [state.protocol, state.specimen].filter(Boolean).join(", ") || state.bench);
  const progress = state.progress;
  at("bar").hidden = !progress;
  at("bar").value = progress ? progress.fraction : 0;
  show("progress", progress ? `${progress.done} of ${progress.entries}${progress.label ? ", " + progress.label : ""}; ${progress.left}` : "");
  show("result", state.result ? state.result.text + (state.result.reason ? ": " + state.result.reason : "") : "");
  fill(at("estimates"), state.result ? state.result.estimates : []);
  fill(at("messages"), state.messages.map(([time, text]) => `${time}  ${text}`).reverse());
  document.title = (state.operator_needed ? "! " : "") + state.state + ", Tactor Bench";
  show("seen", "Updated " + new Date().toLocaleTimeString());
  draw(state.points, state.simulated);
}

async function update() {
  try {
    const headers = token ? { Authorization: "Bearer " + token } : {};
    const answer = await fetch("state.json", { headers, cache: "no-store", signal: AbortSignal.timeout(4000) });
    if (answer.status === 401) trouble("This address has no valid token: scan the code in the window's settings again.");
    else if (!answer.ok) trouble("The program answered with an error: " + answer.status);
    else render(await answer.json());
  } catch (error) {
    trouble("No answer from the program: look at the bench.");
  }
  setTimeout(update, PERIOD_MS);
}

window.addEventListener("hashchange", () => location.reload());
update();
