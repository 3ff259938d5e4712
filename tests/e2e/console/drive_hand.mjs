// SPDX-License-Identifier: Apache-2.0
// drive_hand.mjs JSON: holds the needle in the console's page by keys, mouse, touch and gamepad. The argument: {link, view_link, chromium,
// out, slices, bone}; the last two are scenes. Prints one JSON object: {failures, figures, sessions}; pictures go to the folder `out`.
import { driver, events_of, pill, set_hidden } from "./browser.mjs";

const figures = {}, sessions = {};  // a session: {recording, samples: [[t_s, N that the bar says, lag in mm]], lost_at?...}
const { given, browser, check, until, get } = await driver({ figures, sessions }, 12000);

const kAbove_m = 0.195;  // the tip above the first of the three slices, which is at 0.19 m
const kPunctures = events_of("puncture");

async function start(page, scene) {
  await page.evaluate("window.samples = []");
  await browser.start(page, scene);
  if (await page.isVisible("#hand-help")) await page.click("#hand-help-close");
}
/// Notes in each frame what the bar says, from now on in each session.
const sample = (page) => page.evaluate(() => {
  window.samples = [];
  const note = () => {
    if (trocar.hand.is_held) window.samples.push([trocar.row.t_s[0], parseFloat(document.getElementById("hand-force-N").textContent), parseFloat(document.getElementById("hand-force-mm").textContent)]);
    requestAnimationFrame(note);
  };
  requestAnimationFrame(note);
});
async function stop(page, name) {
  await page.keyboard.press("Shift+Q");
  await until(page, `trocar.state.state === "ended"`, `the end of ${name}`);
  sessions[name] = { recording: (await get(page, "trocar.state")).recording, samples: await get(page, "window.samples ?? []") };
}
const is_mine = `trocar.hand.is_held && trocar.hand.holder === "yours"`;

/// Takes the needle by `act`: again, if the page was too slow for the session on a busy machine.
async function take(page, what, act = () => page.click("#hand-take")) {
  for (const end = Date.now() + 20000; Date.now() < end; await page.waitForTimeout(50)) {
    if (await get(page, is_mine)) return;
    if (await get(page, "!trocar.hand.is_held")) await act();
  }
  browser.fail(`${what}: the needle was not given; the page says "${await get(page, "trocar.hand.words")}"`);
}
/// Takes the needle again if it was lost on a busy machine, as while a picture is taken.
async function hold_again(page, what) {
  if (await get(page, is_mine)) return;
  console.error(`${what}: held again; the page said "${await get(page, "trocar.hand.words")}"`);
  await take(page, what);
}

/// Does `act` and returns how far it moved the target, m, once the needle was held all the time.
async function motion_by(page, what, act) {
  for (let attempt = 0; attempt < 8; ++attempt) {
    await hold_again(page, what);
    const from = await get(page, "trocar.hand.target");
    await act();
    await page.waitForTimeout(100);
    const to = await get(page, "trocar.hand.target");
    if (await get(page, is_mine)) return to.map((x, k) => x - from[k]);
  }
  browser.fail(`${what}: the needle was lost each time`);
  return [0, 0, 0];
}

/// Moves the needle by `act` until the expression is true; then `rest` ends the motion.
async function move_until(page, expression, what, act, rest) {
  await act();
  for (const end = Date.now() + 30000; !await get(page, expression); await page.waitForTimeout(20)) {
    if (Date.now() > end) {
      await until(page, expression, what, 0);
      break;
    }
    if (await get(page, is_mine)) continue;
    await rest();
    await hold_again(page, what);
    await act();
  }
  await rest();
}

/// Presses through a slice and draws back, by the functions `press` and `withdraw`; `rest` ends the motion.
async function puncture(page, name, { press, withdraw, rest }) {
  const picture = async (what) => {
    await browser.picture(page, `${name}_${what}`);
    await hold_again(page, name);
  };
  await move_until(page, "Math.abs(trocar.row.tip_N[0]) > 5 && trocar.hand.force_N > 15", `${name}: contact`, press, rest);
  const lag_mm = await get(page, "trocar.hand.lag_mm");
  check(lag_mm > 1, `${name}: the needle is only ${lag_mm} mm behind the dot`);
  await picture("contact");
  await move_until(page, `${kPunctures} >= 1`, `${name}: the break`, press, rest);
  await picture("break");
  await move_until(page, `trocar.row.tool_m[2] > ${kAbove_m}`, `${name}: the withdrawal`, withdraw, rest);
  await until(page, "trocar.hand.force_N < 2", `${name}: no force after the withdrawal`);
  check(await get(page, "trocar.hand.felt.contact >= 1 && trocar.hand.felt.breach >= 1"), `${name}: contact or break was not felt: ${JSON.stringify(await get(page, "trocar.hand.felt"))}`);
}

// ---- keys ----
const page = await browser.open(given.link);
await page.evaluate(() => {
  window.bursts = 0;
  const start = AudioBufferSourceNode.prototype.start;
  AudioBufferSourceNode.prototype.start = function (...when) {
    ++window.bursts;
    return start.apply(this, when);
  };
});
await until(page, "trocar.bone_shown_ms !== null", "the bone of the first scene");
check((await page.innerText("#scenes")).includes("the needle is held from this page"), "the list of scenes does not say that a needle is held from the page");
await page.selectOption("#start-scene", given.slices);
await page.click("#start");
await until(page, `trocar.state.state === "running" && trocar.row?.safety[0] === 2`, "the first session");
await until(page, `document.getElementById("hand-help").checkVisibility()`, "the help at the first session");
await page.waitForTimeout(300);
await browser.picture(page, "help");
await page.click("#hand-help-close");
await sample(page);
check(await page.isVisible("#hand-take") && !await page.isVisible("#hand-force"), "the bar before the needle is taken");
const before = await get(page, "trocar.row.tool_m");
await take(page, "the key H", () => page.keyboard.press("h"));
await page.waitForTimeout(300);
check(Math.hypot(...(await get(page, "trocar.row.tool_m")).map((x, k) => x - before[k])) < 2e-4, "the tip jumped when the needle was taken");
figures.motion_ms = await latency(page);
await browser.picture(page, "held");
await hold_again(page, "held");
await puncture(page, "keys", {
  press: () => page.keyboard.down("f"),
  withdraw: () => page.keyboard.down("r"),
  rest: async () => { await page.keyboard.up("f"); await page.keyboard.up("r"); },
});
check(await get(page, "window.bursts") >= 3, `only ${await get(page, "window.bursts")} sounds were played`);
// Pause, above the bone: the target goes to the tip, and stays there.
await hold_again(page, "the pause");
await page.keyboard.down("f");
await page.waitForTimeout(200);
await page.click("#pause");
await until(page, `${pill} === "Paused"`, "the pause");
await page.waitForTimeout(200);
const paused = await get(page, "[trocar.hand.target, trocar.row.tool_m, trocar.hand.is_held]");
check(!paused[2] || Math.hypot(...paused[0].map((x, k) => x - paused[1][k])) < 1e-6, `in the pause the target is at ${paused[0]}, the tip at ${paused[1]}`);
await page.keyboard.up("f");
await page.click("#pause");
await until(page, `${pill} === "Running" && ${events_of("resumed")} === 1`, "going on after the pause");
await page.waitForTimeout(200);
check(Math.abs(await get(page, "trocar.row.tool_m[2]") - paused[1][2]) < 3e-4, "the tip moved after the pause");
// Letting go: by H, by blur, by a hidden page, by another tab of the page, by a session that does not answer, by Esc.
const lets_go = async (what, act) => {
  await take(page, `before ${what}`);
  await act();
  check(await get(page, "!trocar.hand.is_held"), `${what} did not let go`);
  await until(page, `trocar.hand.holder === "free"`, `the console's word after ${what}`);
};
await lets_go("H", () => page.keyboard.press("h"));
await lets_go("blur", () => page.evaluate(() => { dispatchEvent(new Event("blur")); }));
await lets_go("another tab", async () => { await page.click("[data-to=folder]"); await page.waitForTimeout(100); await page.click("[data-to=session]"); });
await lets_go("a hidden page", async () => { await set_hidden(page, true); await set_hidden(page, false); });
await lets_go("a session that does not answer", async () => {
  process.kill(await get(page, "trocar.pid"), "SIGSTOP");
  await until(page, `trocar.state.state === "silent"`, "a session that does not answer");
  process.kill(await get(page, "trocar.pid"), "SIGCONT");
});
check(/did not answer/.test(await page.innerText("#hand-words")), `the silence is not told: "${await page.innerText("#hand-words")}"`);
await lets_go("Esc", () => page.keyboard.press("Escape"));
await until(page, `trocar.events.some((event) => event.fault === "emergency_stop")`, "the emergency stop by Esc while the needle is held");
await stop(page, "keys");

/// The times, in ms, from a message whose target has moved by a notch of the wheel until a snapshot has the tip's first motion (a twentieth
/// of the notch), and until the frame after that.
async function latency(page) {
  return page.evaluate(async () => {
    let worker = null, sent_ms = 0, moved_ms = 0, target = null, tip = null;
    const send = Worker.prototype.postMessage;
    Worker.prototype.postMessage = function (message, ...more) {
      if (message.hold && worker !== this) (worker = this).addEventListener("message", () => {
        if (sent_ms && !moved_ms && Math.hypot(...trocar.row.tool_m.map((x, k) => x - tip[k])) > 2e-5) moved_ms = performance.now();
      });
      if (message.hold && target && !sent_ms && Math.hypot(...target.map((x, k) => message.hold[k] - x)) > 1e-5) sent_ms = performance.now();
      return send.call(this, message, ...more);
    };
    const wait = (ms) => new Promise((done) => setTimeout(done, ms));
    const key = (kind, code) => dispatchEvent(new KeyboardEvent(kind, { code }));
    const frame = () => new Promise((done) => requestAnimationFrame(done));
    const snapshot = [], drawn = [];
    for (let turn = 0; turn < 60 && snapshot.length < 24; ++turn) {
      if (!trocar.hand.is_held) key("keydown", "KeyH");  // a busy machine: the session has let go
      await wait(250);
      [target, tip, sent_ms, moved_ms] = [trocar.hand.target, trocar.row.tool_m, 0, 0];
      document.getElementById("canvas").dispatchEvent(new WheelEvent("wheel", { deltaY: turn % 2 ? -100 : 100, cancelable: true }));
      for (const end = performance.now() + 1000; !moved_ms && performance.now() < end;) await frame();
      const shown_ms = performance.now();
      if (moved_ms) snapshot.push(moved_ms - sent_ms), drawn.push(shown_ms - sent_ms);
    }
    Worker.prototype.postMessage = send;
    const of = (list, share) => +list.sort((a, b) => a - b)[Math.floor(share * (list.length - 1))]?.toFixed(1);
    return { turns: snapshot.length, snapshot_median: of(snapshot, 0.5), snapshot_95: of(snapshot, 0.95), drawn_median: of(drawn, 0.5), drawn_95: of(drawn, 0.95) };
  });
}
check(figures.motion_ms.turns === 24, `the tip followed in only ${figures.motion_ms.turns} of 60 turns`);

// ---- mouse ----
await start(page, given.slices);
const box = await page.locator("#canvas").boundingBox();
const middle = [box.x + box.width / 2, box.y + box.height / 2];
const drag = async (button, from, way, steps = 10) => {
  await page.mouse.move(...from);
  await page.mouse.down({ button });
  for (let k = 1; k <= steps; ++k) await page.mouse.move(from[0] + way[0] * k / steps, from[1] + way[1] * k / steps);
  await page.mouse.up({ button });
};
const up = () => get(page, "trocar.camera.up");
// The camera goes down until it looks sideways, so that a drag downwards is along the tool. Nothing is held yet: the drag is the camera's.
for (let turn = 0; turn < 160 && (await up())[2] < 0.999; ++turn) await drag("left", middle, [0, -3], 2);
check((await up())[2] > 0.999, `a drag did not turn the camera before the needle was taken: ${await up()}`);
await take(page, "taking the needle by its button");
const camera = await get(page, "trocar.camera");
const is_turned = async () => JSON.stringify(await get(page, "trocar.camera")) !== JSON.stringify(camera);
const aside = await motion_by(page, "a drag", () => drag("left", middle, [15, 0]));
check(Math.hypot(...aside) > 5e-4, `a drag moved the needle by ${aside} m`);
check(!await is_turned(), "a drag turned the camera while the needle was held");
await motion_by(page, "a drag back", () => drag("left", [middle[0] + 15, middle[1]], [-15, 0]));
const turned = await motion_by(page, "the right button", () => drag("right", middle, [40, 0]));
check(Math.hypot(...turned) === 0 && await is_turned(), "the right button did not turn the camera while the needle was held");
await page.click("#hand-take");
check(await get(page, "!trocar.hand.is_held"), "the button did not let go");
const let_go = await get(page, "trocar.camera");
await drag("left", middle, [40, 0]);
check(JSON.stringify(await get(page, "trocar.camera")) !== JSON.stringify(let_go), "a drag does not turn the camera after letting go");
await stop(page, "mouse");

// ---- gamepad ----
await page.evaluate(() => {
  const buttons = Array.from({ length: 17 }, () => ({ pressed: false, value: 0 }));
  window.rumbles = [];
  window.pad = { connected: true, mapping: "standard", axes: [0.05, -0.05, 0, 0], buttons,
    vibrationActuator: { playEffect: async (kind, effect) => void window.rumbles.push({ kind, ...effect }) } };
  Object.defineProperty(navigator, "getGamepads", { configurable: true, value: () => [null, window.pad] });
});
const press = (k, value) => page.evaluate(([k, value]) => { Object.assign(window.pad.buttons[k], { value, pressed: value > 0.5 }); }, [k, value]);
await start(page, given.slices);
await take(page, "the gamepad", async () => {
  await press(0, 1);
  await page.waitForTimeout(200);
  await press(0, 0);
});
const stick = await motion_by(page, "the stick", async () => {
  await page.evaluate("window.pad.axes[0] = 0.6");
  await page.waitForTimeout(300);
  await page.evaluate("window.pad.axes[0] = 0");
});
check(Math.hypot(...stick) > 3e-4 && Math.abs(stick[2]) < 1e-5, `the stick moved the needle by ${stick} m`);
await puncture(page, "gamepad", { press: () => press(7, 0.8), withdraw: () => press(6, 1), rest: async () => { await press(7, 0); await press(6, 0); } });
const strong = await get(page, "window.rumbles.filter(({ strongMagnitude }) => strongMagnitude > 0.3).length");
check(strong >= 1 && await get(page, `window.rumbles.every(({ kind }) => kind === "dual-rumble")`), `the break rumbled ${strong} times`);
await press(1, 1);
await until(page, "!trocar.hand.is_held", "letting go by the gamepad");
await press(1, 0);
await stop(page, "gamepad");
await page.evaluate("window.pad.connected = false");

// ---- through bone, where the work of cutting crunches; the switch of the sound is remembered ----
await start(page, given.bone);
await take(page, "taking the needle above the bone");
await move_until(page, "trocar.row.cut_J[0] > 0.01 && trocar.hand.felt.crunch > 5", "cutting bone", () => page.keyboard.down("f"), () => page.keyboard.up("f"));
await browser.picture(page, "bone");
await page.click("#hand-sound");
check(await get(page, `localStorage.getItem("trocar-hand-sound") === "off"`), "the switch of the sound is not remembered");
await page.waitForTimeout(100);
const quiet = await get(page, "window.bursts");
await hold_again(page, "bone");
await page.keyboard.down("f");
await page.waitForTimeout(400);
check(await get(page, "window.bursts") === quiet, "sounds are played although they are off");
await page.keyboard.up("f");
await stop(page, "bone");
check(await get(page, "!trocar.hand.is_held"), "the end of the session did not let go");

// ---- two operators and an audience: one holder ----
await start(page, given.slices);
const other = await browser.open(given.link), audience = await browser.open(given.view_link);
for (const one of [other, audience]) await until(one, `trocar.state.state === "running" && trocar.row && trocar.bone_shown_ms !== null`, "the second page");
if (await other.isVisible("#hand-help")) await other.click("#hand-help-close");
await take(page, "the first page's needle");
await until(other, `trocar.hand.holder === "other" && document.getElementById("hand-words").textContent === "Another page holds the needle."`, "the second page's words");
for (let attempt = 0; attempt < 8; ++attempt) {
  if (await get(other, "trocar.hand.is_held")) await other.keyboard.press("h");
  await hold_again(page, "two pages");
  await until(other, `trocar.hand.holder === "other"`, "the console's word to the second page");
  const [is_disabled, sent] = [await other.isDisabled("#hand-take"), await get(other, "trocar.hand.sent")];
  await other.keyboard.press("h");
  await other.waitForTimeout(200);
  const has_taken = await get(other, `trocar.hand.is_held || trocar.hand.sent > ${sent}`);
  if (!await get(page, is_mine) && attempt < 7) continue;  // the first page lost it on a busy machine: then the second one may take it
  check(is_disabled && !has_taken, "the second page could take the needle");
  break;
}
await browser.picture(other, "other");
await hold_again(page, "pages");
check(!await audience.isVisible("#hand-bar"), "the audience has the hand's controls");
const seen = await get(audience, "trocar.row.tool_m[2]");
await move_until(page, "trocar.hand.force_N > 10", "a force by the first page", () => page.keyboard.down("f"), () => page.keyboard.up("f"));
check(await get(audience, "trocar.row.tool_m[2]") < seen - 5e-3, "the audience does not see the needle move");
await audience.close();
await page.setViewportSize({ width: 500, height: 400 });  // it only watches: without a GPU, each page that is drawn slows the others
await page.evaluate(() => { if (trocar.hand.is_held) document.getElementById("hand-take").click(); });  // it may just have been lost
await until(other, `trocar.hand.holder === "free" && trocar.hand.words === ""`, "the free needle on the second page");
await take(other, "the second page's needle", () => other.keyboard.press("h"));
await until(page, `trocar.hand.holder === "other"`, "the first page's word");

// ---- silence, and a page that is closed, while the needle presses ----
const force = "Math.hypot(...trocar.row.wrench_delivered.slice(0, 3))";
/// Presses in `other` until 8 N. On a busy machine the key may be released so late that the slice breaks; then the next slice is pressed.
async function press_in_other(what) {
  for (let attempt = 0; attempt < 5 && await get(page, force) < 4; ++attempt) {
    await move_until(other, "trocar.hand.force_N > 8", `a force before ${what}`, () => other.keyboard.down("f"), () => other.keyboard.up("f"));
    await other.waitForTimeout(300);
  }
  check(await get(page, force) > 4, `the force before ${what} is only ${await get(page, force)} N`);
}
const lost = await get(page, events_of("hand_lost"));
/// The worker with the WebSocket.
const link_of = (one) => one.workers().find((worker) => worker.url().endsWith("live_worker.js"));
await press_in_other("silence");
await link_of(other).evaluate(() => {  // no message of the hand leaves the page
  const send = WebSocket.prototype.send;
  WebSocket.prototype.send = function (words) { if (!("hand" in JSON.parse(words))) send.call(this, words); };
});
await until(page, `${force} < 1`, "the force after silence");
await until(page, `${events_of("hand_lost")} > ${lost}`, "the event of a lost hand");
await until(other, "!trocar.hand.is_held", "a lost hand on its own page");
check(/let go of the needle, because this page sent nothing/.test(await other.innerText("#hand-words")), `the lost hand is not told: ${await other.innerText("#hand-words")}`);
await browser.picture(other, "lost");
await other.close();
// One slow frame takes nothing from the operator: the worker goes on sending. A page that stands still for longer lets go, and what it does
// when it goes on does not take the needle again.
await take(page, "holding before a slow frame");
const losses = `${events_of("hand_lost")} + ${events_of("hand_let_go")}`, losses_before = await get(page, losses);
const stand_still = (ms) => page.evaluate((for_ms) => { for (const end = performance.now() + for_ms; performance.now() < end;); }, ms);
await stand_still(700);
await page.waitForTimeout(300);
check(await get(page, is_mine) && await get(page, losses) === losses_before, `a frame of 0.7 s lets the needle go: "${await get(page, "trocar.hand.words")}"`);
await stand_still(1600);
await until(page, "!trocar.hand.is_held", "letting go after a frame of 1.6 s");
check(/stood still/.test(await get(page, "trocar.hand.words")), `a frame of 1.6 s is not told: "${await get(page, "trocar.hand.words")}"`);
await until(page, `trocar.hand.holder === "free"`, "the console's word after a frame of 1.6 s");
await page.waitForTimeout(300);
check(await get(page, losses) === losses_before + 1, "the needle was taken again by a page that stood still");
// A picture that is lost lets go, is told, and comes back.
await take(page, "holding before the picture is lost");
await page.waitForTimeout(600);
await page.evaluate(() => { (window.lost_context = document.getElementById("canvas").getContext("webgl2").getExtension("WEBGL_lose_context")).loseContext(); });
await until(page, `/view is blank/.test(trocar.words) && !trocar.hand.is_held`, "the words about a lost picture");
await browser.shot(page, "lost_picture");
check(await get(page, `document.getElementById("hand-take").disabled || !trocar.hand.is_held`), "the needle is held without a picture");
await page.evaluate("window.lost_context.restoreContext()");
await until(page, `!/view is blank/.test(trocar.words)`, "the picture again");
await page.waitForTimeout(500);
await browser.shot(page, "picture_again");
// A connection that drops.
await take(page, "holding before the connection drops");
await link_of(page).evaluate(() => {
  const send = WebSocket.prototype.send;
  WebSocket.prototype.send = function (words) {
    WebSocket.prototype.send = send;
    this.close();
    return words;
  };
});
await until(page, "!trocar.hand.is_held", "a dropped connection");
check(/connection was lost/.test(await get(page, "trocar.hand.words")), `the dropped connection is not told: ${await get(page, "trocar.hand.words")}`);
await until(page, "trocar.is_connected", "the connection again");
await stop(page, "pages");
await page.close();

// ---- touch, in the window of a phone ----
const phone = await browser.open(given.link, { viewport: { width: 390, height: 780 }, hasTouch: true, isMobile: true });
await until(phone, "trocar.bone_shown_ms !== null", "the bone on a phone");
await phone.tap("[data-to=folder]");
await phone.selectOption("#start-scene", given.slices);
const last = await get(phone, "trocar.session");
await phone.tap("#start");
await until(phone, `trocar.session !== ${JSON.stringify(last)} && trocar.state.state === "running" && trocar.row?.safety[0] === 2`, "the session on a phone");
await until(phone, `document.getElementById("hand-help").checkVisibility()`, "the help on a phone");
await phone.waitForTimeout(300);
await browser.picture(phone, "phone_help", true);
await phone.tap("#hand-help-close");
await take(phone, "a touch", () => phone.tap("#hand-take"));
await phone.waitForTimeout(300);
await browser.picture(phone, "phone_held", true);
await hold_again(phone, "touch");
const fingers = await phone.context().newCDPSession(phone);
const touch = (type, points) => fingers.send("Input.dispatchTouchEvent", { type, touchPoints: points.map(([x, y], id) => ({ x, y, id })) });
const glass = await phone.locator("#canvas").boundingBox();
const centre = [glass.x + glass.width / 2, glass.y + glass.height / 2];
// Two fingers pinch: the camera, and not the needle.
const away_m = await get(phone, "trocar.camera.away_m");
const pinch = await motion_by(phone, "two fingers", async () => {
  await touch("touchStart", [[centre[0] - 20, centre[1]]]);
  await touch("touchStart", [[centre[0] - 20, centre[1]], [centre[0] + 20, centre[1]]]);
  for (let k = 1; k <= 8; ++k) await touch("touchMove", [[centre[0] - 20 - 3 * k, centre[1]], [centre[0] + 20 + 3 * k, centre[1]]]);
  await touch("touchEnd", [[centre[0] - 44, centre[1]]]);
  await touch("touchMove", [[centre[0] - 64, centre[1] + 30]]);  // the finger that stays
  await touch("touchEnd", []);
});
check(Math.hypot(...pinch) === 0, `two fingers moved the needle by ${pinch} m`);
check(Math.abs(await get(phone, "trocar.camera.away_m") - away_m) > 1e-3, "two fingers did not move the camera");
const swiped = await motion_by(phone, "a finger", async () => {
  await touch("touchStart", [centre]);
  for (let k = 1; k <= 8; ++k) await touch("touchMove", [[centre[0], centre[1] + 3 * k]]);
  await touch("touchEnd", []);
});
check(Math.hypot(...swiped) > 5e-4, `a finger moved the needle by ${swiped} m`);
const hold = await phone.locator("#hand-in").boundingBox();
const pressed = await motion_by(phone, "the button Push in", async () => {
  await touch("touchStart", [[hold.x + hold.width / 2, hold.y + hold.height / 2]]);
  await phone.waitForTimeout(300);
  await touch("touchEnd", []);
});
check(pressed[2] < -5e-4, `the button Push in moved the needle by ${pressed} m`);
await stop(phone, "touch");

await browser.finish();
