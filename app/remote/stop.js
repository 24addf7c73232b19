"use strict";
const button = document.getElementById("stop"), answer = document.getElementById("answer");

async function stop() {
  if (!confirm("Stop the run?")) return;
  button.disabled = true;
  answer.textContent = "Stop requested; waiting for rest …";
  try {
    const headers = { Authorization: "Bearer " + location.hash.slice(1) };
    const reply = await fetch("stop", { method: "POST", headers, cache: "no-store", signal: AbortSignal.timeout(40000) });
    answer.textContent = reply.status === 401 ? "Not stopped: this address belongs to no present run." : await reply.text();
    button.disabled = reply.status === 200;
  } catch (error) {
    answer.textContent = "No answer: the run may go on. Try again, or look at the bench.";
    button.disabled = false;
  }
}

button.addEventListener("click", stop);
