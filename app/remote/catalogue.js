"use strict";
// Exchanges the token of the address for a cookie, which links and pictures send; the token then leaves the address bar.
const token = location.hash.slice(1);
if (token) {
  fetch("/session", { headers: { Authorization: "Bearer " + token }, cache: "no-store" }).then((answer) => {
    if (answer.ok) location.replace(location.pathname + location.search);
    else document.getElementById("trouble").textContent = "This address has no valid token: ask for the present one.";
  });
}
