// Starts what the page has.

function complain(words) {
  const notice = document.getElementById("notice");
  notice.textContent = words;
  notice.hidden = false;
}

async function start() {
  theme.start();
  if (!("DecompressionStream" in window) || !("roundRect" in CanvasRenderingContext2D.prototype)) {
    complain("This browser is too old for the replay (it needs one of 2023 or later).");
    return;
  }
  const data = JSON.parse(new TextDecoder().decode(await unpacked("data")));
  const columns = new Columns(await unpacked("columns"));
  const section = document.getElementById("replay");
  if (section && data.groups.length) new Keys(new Player(section, data, columns));
  const curves = document.querySelector(".training .curves");
  if (curves) startTraining(curves.closest("section"), data.training);
}

start();
