"use strict";
// Frames of a film: each requested time is drawn and written as an image into the page.

const film = JSON.parse(document.getElementById("data").textContent);
const canvas = document.getElementById("scene"), scene = new Scene(canvas, film.scene);
scene.background = film.background;
for (const shot of film.shots) {
  Object.assign(scene.view, shot.view);
  scene.draw(shot.state, []);
  const line = document.createElement("i");
  line.textContent = canvas.toDataURL("image/jpeg", 0.95);
  document.body.append(line);
}
