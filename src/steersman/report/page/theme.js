// Colours of the page's style sheet for canvases, and the switch between light and dark.

const theme = {
  colors: {},
  listeners: [],

  read() {
    const style = getComputedStyle(document.documentElement);
    for (const name of ["ink", "soft", "paper", "panel", "line", "ground", "road", "edge", "accent", "bad"]) {
      this.colors[name] = style.getPropertyValue(`--${name}`).trim();
    }
    this.font = getComputedStyle(document.body).fontFamily;
  },

  dark() {
    const chosen = document.documentElement.dataset.theme;
    return chosen ? chosen === "dark" : matchMedia("(prefers-color-scheme: dark)").matches;
  },

  choose(name) {
    document.documentElement.dataset.theme = name;
    this.changed();
  },

  changed() {
    this.read();
    for (const button of document.querySelectorAll(".theme")) {
      button.textContent = this.dark() ? "Light" : "Dark";
      button.setAttribute("aria-label", `Show the page ${this.dark() ? "light" : "dark"}`);
    }
    for (const listener of this.listeners) listener();
  },

  start() {
    for (const button of document.querySelectorAll(".theme")) {
      button.hidden = false;
      button.addEventListener("click", () => this.choose(this.dark() ? "light" : "dark"));
    }
    matchMedia("(prefers-color-scheme: dark)").addEventListener("change", () => this.changed());
    this.changed();
  },
};
