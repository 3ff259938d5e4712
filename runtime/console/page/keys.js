// SPDX-License-Identifier: Apache-2.0
// The keys of the page. Esc is the emergency stop, Shift and Q end the session, and space pauses it, or plays a recording. Space presses a
// button that has the focus, as in any page, so no key ends a session by a slip. Buttons that act while they are pressed are here, too.

/// True where the browser itself has a meaning for the space key.
const takes_space = (target) => target instanceof Element && target.closest("button, a, input, select, textarea, summary, iframe, [tabindex]:not([tabindex='-1'])") !== null;

/// Takes the focus out of a frame with another page while a session runs, because keys in a frame do not reach this page.
export function take_keys_back() {
  if (document.activeElement?.tagName === "IFRAME") document.getElementById("report-close").focus();
}

/// Calls set(true) when a button is pressed by the main button of a mouse, a pen or a finger, and set(false) when it is released. A finger
/// may rest on the button and move, which elsewhere opens a menu, scrolls the page or selects text.
export function while_pressed(button, set) {
  button.classList.add("pressed-long");
  button.addEventListener("pointerdown", (event) => {
    if (event.button !== 0) return;
    button.setPointerCapture(event.pointerId);
    set(true);
  });
  for (const end of ["pointerup", "pointercancel", "lostpointercapture"]) button.addEventListener(end, () => set(false));
  button.addEventListener("contextmenu", (event) => event.preventDefault());  // a long touch
}

/// `act`: {app, is_running, emergency_stop, stop, pause, play, notice}.
export function listen_to_keys({ app, ...act }) {
  addEventListener("keydown", (event) => {
    if (event.key === "Escape") {
      // People who watch leave menus and full screen by Esc. Their button for the emergency stop works.
      if (app.role !== "operator") {
        if (act.is_running() && !event.repeat) act.notice("Esc commands nothing on a page of the audience; the button Emergency stop does.");
        return;
      }
      event.preventDefault();
      if (!event.repeat) act.emergency_stop();
      return;
    }
    if (event.repeat || event.ctrlKey || event.altKey || event.metaKey) return;
    const is_running = act.is_running(), is_operator = app.role === "operator";
    const is_typing = event.target instanceof Element && event.target.closest("input, select, textarea") !== null;
    if (event.code === "KeyQ" && event.shiftKey && is_running && is_operator && !is_typing) {
      event.preventDefault();
      act.stop();
    }
    if (event.code !== "Space" || takes_space(event.target) || (document.getElementById("report-box").open && !is_running)) return;
    event.preventDefault();
    if (is_running && is_operator && app.state.state !== "starting") act.pause();
    if (!is_running && app.tab === "playback") act.play();
  }, true);
  // The frame has the focus only after this event.
  addEventListener("blur", () => setTimeout(() => { if (act.is_running()) take_keys_back(); }));
  // A button that was clicked keeps no focus, so that a later space key does not press it again. Keys leave the focus where it is.
  addEventListener("click", (event) => {
    const button = event.detail > 0 && event.target instanceof Element ? event.target.closest("button") : null;
    if (button && button === document.activeElement) button.blur();
  });
}
