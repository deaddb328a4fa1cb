// The keyboard. Keys act while the focus is in the player, or nowhere and the player is on screen;
// letters can be switched off in the help (as WCAG 2.1.4 asks).

const SEEK = { time: [1, null], along: [10, 1] };

class Keys {
  constructor(player) {
    this.player = player;
    const { help, keys, open, close } = player.parts;
    this.help = help;
    this.enabled = keys;
    open.addEventListener("click", () => this.toggleHelp());
    close.addEventListener("click", () => help.close());
    document.addEventListener("keydown", (event) => this.pressed(event));
    const p = player;
    this.actions = {
      " ": () => p.toggle(),
      ArrowLeft: (event) => this.seek(-1, event.shiftKey),
      ArrowRight: (event) => this.seek(1, event.shiftKey),
      ArrowUp: () => p.faster(1),
      ArrowDown: () => p.faster(-1),
      Home: () => p.seek(-Infinity),
      End: () => p.seek(Infinity),
      "+": () => p.zoom(1.25),
      "=": () => p.zoom(1.25),
      "-": () => p.zoom(0.8),
      0: () => p.fit(),
      f: () => p.followOn(!p.state.follow),
      r: () => p.turnOn(!p.state.turned),
      n: () => p.step(1),
      p: () => p.step(-1),
      "?": () => this.toggleHelp(),
      Escape: () => p.parts.map.focus(),
    };
  }

  pressed(event) {
    if (event.defaultPrevented || event.ctrlKey || event.metaKey || event.altKey) return;
    const act = this.actions[event.key];
    if (!act || !this.listens(event)) return;
    event.preventDefault();
    act(event);
  }

  listens(event) {
    const { target, key } = event;
    if (this.help.open) return key === "?";
    if (!this.enabled.checked && key.length === 1 && key !== " ") return false;
    if (key === "Escape") return this.player.section.contains(target);
    // These have a use for keys of their own.
    if (target.closest("select, textarea, input:not([type=range])")) return false;
    if (key === " " && target.closest("button, summary, a")) return false;
    if (this.player.section.contains(target)) return true;
    return target === document.body && this.onScreen();
  }

  onScreen() {
    const { top, bottom } = this.player.parts.map.getBoundingClientRect();
    return bottom > 0 && top < window.innerHeight;
  }

  seek(direction, fine) {
    const { state } = this.player;
    const [coarse, small] = SEEK[state.axis];
    const step = fine ? small ?? state.lead.dt : coarse;
    this.player.seek(state.cursor + direction * step);
  }

  toggleHelp() {
    if (this.help.open) this.help.close();
    else this.help.showModal();
  }
}
