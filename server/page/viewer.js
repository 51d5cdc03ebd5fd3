// Connects to the server, sends the head's pose, draws the stereo pairs that come back. Reconnects after a lost connection.

import { decode, encode } from "./msgpack.js";
import { Head } from "./head.js";

const IPD = 0.063; // metres
const HALF_HEIGHT = 0.632; // tangent of half the vertical field of view
const WIDEST = 2.4; // horizontal field of view, radians
const MOST_PX = 1280 * 960; // of an eye: larger windows show enlarged pictures
const RESIZED_MS = 300;
const IN_FLIGHT = 2;
const RETRY_MS = 1500;
const PROGRESS_MS = 400;
const TOKEN_REFUSED = 4401; // close code: trying again makes no sense
const element = (id) => document.getElementById(id);
const canvas = element("picture");
const head = new Head(canvas);
const token = new URLSearchParams(location.search).get("token") ?? "";
const state = { canvas, socket: null, scene: null, sent: 0, answered: 0, seen: 0, model: "", frame: -1, moved: performance.now(), times: [], latency: 0 };
globalThis.farside = state; // for inspection from the browser's console

// Pictures have the size of the place where they are shown.
function eye() {
  const box = canvas.getBoundingClientRect();
  const [width, height] = [box.width / (isBoth() ? 2 : 1), box.height].map((side) => Math.max(16, side * devicePixelRatio));
  const scale = Math.min(1, Math.sqrt(MOST_PX / (width * height)), 4096 / width, 4096 / height);
  const even = (side) => Math.max(16, 2 * Math.round(side * scale / 2));
  return { width: even(width), height: even(height), fov: Math.min(WIDEST, 2 * Math.atan(HALF_HEIGHT * width / height)), ipd: IPD };
}

function isBoth() { return element("eyes").value === "both"; }

function connect() {
  const address = new URL("viewer", document.baseURI); // under the page's own path
  address.protocol = address.protocol === "https:" ? "wss:" : "ws:";
  const socket = new WebSocket(address);
  let refusal = "";
  socket.binaryType = "arraybuffer";
  socket.onopen = () => {
    Object.assign(state, { socket, sent: 0, answered: 0, seen: 0 });
    const hello = { type: "hello", version: 2, role: "viewer", token, axes: "openxr", encoding: "jpeg", ...eye() };
    state.size = `${hello.width}x${hello.height}`;
    socket.send(encode(hello));
  };
  socket.onmessage = async (event) => {
    const message = decode(event.data);
    if (message.type === "welcome") tellProgress(socket, message.settings.background);
    else if (message.type === "scene") arrive(message);
    else if (message.type === "stereo") await show(message);
    else if (message.type === "error") refusal = `${message.field}: ${message.value}: expected ${message.expected}`;
  };
  socket.onclose = (event) => {
    state.socket = null;
    if (socket.resized) { connect(); return; }
    if (event.code === TOKEN_REFUSED) { complain(`${refusal || event.reason}: open the address that the server printed`); return; }
    complain(`no connection: ${refusal || event.reason || "the server does not answer"}; trying again`);
    setTimeout(connect, RETRY_MS);
  };
}

// Until the first picture: what it waits for. Then, until there is a background model, what that waits for.
async function tellProgress(socket, models) {
  let compiling = false;
  state.model = "";
  while (state.socket === socket && (state.seen === 0 || compiling)) {
    const status = await fetch(new URL("status", document.baseURI)).then((answer) => answer.json()).catch(() => null);
    if (state.socket !== socket) return;
    const { first_ready: first, first_of: of_first, ready, of } = status?.kernels ?? {};
    compiling = models && ready < of;
    if (state.seen > 0) {
      const modelled = Object.keys(status?.engine?.background ?? {}).length > 0;
      state.model = compiling && !modelled ? `no background model yet: compiling kernels, ${ready} of ${of}` : "";
    } else if (first < of_first) say(`compiling kernels for the first picture: ${first} of ${of_first} (the first time only)`);
    else say(status?.preparing || (status?.source_connected ? "waiting for the first picture" : "waiting for a source"));
    await new Promise((resolve) => setTimeout(resolve, PROGRESS_MS));
  }
  state.model = "";
}

// The server learns the size of pictures from the hello only.
function resize() {
  clearTimeout(state.resizing);
  state.resizing = setTimeout(() => {
    const { width, height } = eye();
    if (state.socket === null || state.size === `${width}x${height}`) return;
    state.socket.resized = true;
    state.socket.close();
  }, RESIZED_MS);
}

function arrive(scene) {
  if (state.scene === null || state.scene.name !== scene.name) head.start(scene.position, scene.orientation);
  state.scene = scene;
  element("home").onclick = () => head.start(scene.position, scene.orientation);
}

function sendPose() {
  const now = performance.now();
  head.advance((now - state.moved) / 1000);
  state.moved = now;
  if (state.socket?.readyState === WebSocket.OPEN && state.scene && (state.sent - state.answered < IN_FLIGHT)) {
    const pose = { type: "pose", seq: state.sent++, time: now / 1000, position: head.position,
      orientation: head.orientation(), seen: state.seen };
    state.socket.send(encode(pose));
  }
  requestAnimationFrame(sendPose);
}

async function show(stereo) {
  const eyes = isBoth() ? [stereo.left, stereo.right] : [stereo.left];
  const pictures = await Promise.all(eyes.map((eye) => createImageBitmap(new Blob([eye.planes[0]], { type: "image/jpeg" }))));
  state.answered = stereo.seq + 1; // poses before it that the server dropped get no picture
  state.seen += 1;
  canvas.width = stereo.width * pictures.length;
  canvas.height = stereo.height;
  const context = canvas.getContext("2d");
  pictures.forEach((picture, i) => { context.drawImage(picture, i * stereo.width, 0); picture.close(); });
  account(stereo);
}

function account(stereo) {
  const now = performance.now();
  state.frame = stereo.frame;
  state.latency = now - 1000 * stereo.time;
  state.times = [...state.times.filter((time) => time > now - 2000), now];
  const rate = (state.times.length - 1) / Math.max(1e-3, (now - state.times[0]) / 1000);
  const stages = Object.entries(stereo.stages).map(([name, ms]) => `${name} ${ms.toFixed(0)}`).join(" ");
  element("figures").textContent = `${state.scene.name}, frame ${stereo.frame}: ${rate.toFixed(1)} pictures a second, `
    // the first pictures were asked for long before the engine was there
    + `latency ${state.seen > IN_FLIGHT ? state.latency.toFixed(0) : "-"} ms, holes ${(100 * stereo.holes).toFixed(1)} %`
    + (stereo.rung ? `, ${stereo.rung}` : "") + ` (${stages})`;
  say(state.model);
}

function say(text, problem = false) {
  if (element("message").textContent !== text) element("message").textContent = text;
  element("message").classList.toggle("problem", problem);
}

function complain(text) { say(text, true); }

new ResizeObserver(resize).observe(canvas);
element("eyes").addEventListener("change", resize);
connect();
sendPose();
