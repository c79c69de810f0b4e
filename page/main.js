// SPDX-License-Identifier: Apache-2.0
// The frame of the page: the signed-in user, the view, light or dark.
import {html, render, useEffect, useState} from "./preact.js";
import {call, get} from "./api.js";
import {Queue} from "./queue.js";
import {recall, remember, Trouble} from "./parts.js";
import {SignIn} from "./sign-in.js";

/** The view of an address behind the #, and its parts. Views that few people open are loaded when they are. */
const ROUTES = [
  [/^\/?$/, async () => Queue],
  [/^\/jobs\/([0-9a-z]{26})$/, async () => (await import("./job.js")).Job],
  [/^\/jobs\/([0-9a-z]{26})\/points$/, async () => (await import("./points.js")).Points],
  [/^\/compare\/([0-9a-z]{26})\/([0-9a-z]{26})$/, async () => (await import("./compare.js")).Compare],
  [/^\/service$/, async () => (await import("./service.js")).Service],
  [/^\/submit$/, async () => (await import("./submit.js")).Submit],
];

async function findView(hash) {
  const [path, search = ""] = hash.replace(/^#/, "").split("?");
  const found = {View: Lost, ids: [], search: new URLSearchParams(search), path: path || "/"};
  for (const [pattern, load] of ROUTES) {
    const match = pattern.exec(path);
    if (match) Object.assign(found, {ids: match.slice(1), View: await load().catch(() => Unloaded)});
  }
  return found;
}

function Lost() {
  return html`<h1>Nothing is here</h1><p><a href="#/">To the queue</a></p>`;
}

function Unloaded() {
  return html`<${Trouble} error=${new Error("This view could not be loaded. Reload the page once the service answers.")} />`;
}

const THEMES = {"": "System", light: "Light", dark: "Dark"};

function Theme() {
  const [theme, setTheme] = useState(recall("theme") || "");
  useEffect(() => {
    document.documentElement.dataset.theme = theme;
    remember("theme", theme || null);
    dispatchEvent(new Event("theme")); // what is painted and not styled is painted anew
  }, [theme]);
  return html`<label class="theme"><span class="hidden">Colours</span>
    <select value=${theme} onChange=${e => setTheme(e.target.value)}>
      ${Object.entries(THEMES).map(([key, word]) => html`<option value=${key} selected=${key === theme}>${word}</option>`)}
    </select></label>`;
}

function Header({session, path, onSignOut}) {
  const link = (to, word) => html`<a href=${`#${to}`} aria-current=${path === to ? "page" : null}>${word}</a>`;
  return html`<header><a class="brand" href="#/"><img src="page/icon.svg" alt="" width="24" height="24" />hexad</a>
    <nav aria-label="Views">${link("/", "Queue")}${session.scopes.includes("submit") && link("/submit", "New job")}${session.scopes.includes("admin") && link("/service", "Service")}</nav>
    <span class="account">${session.user}</span>${session.ends && html`<button class="plain" onClick=${onSignOut}>Sign out</button>`}
    <${Theme} /></header>`;
}

function App() {
  const [session, setSession] = useState(null);
  const [view, setView] = useState(null);

  const ask = () => get("v1/session").then(setSession, () => setTimeout(ask, 2000));
  useEffect(() => {
    let path = null;
    const show = () => findView(location.hash).then(found => {
      setView(found);
      if (found.path === path) return; // a filter has changed
      path = found.path;
      scrollTo(0, 0);
      const main = document.getElementById("main");
      if (main) main.focus(); // keyboards and screen readers begin with what is new
    });
    ask();
    show();
    addEventListener("hashchange", show);
    addEventListener("signed-out", ask);
    matchMedia("(prefers-color-scheme: dark)").addEventListener("change", () => dispatchEvent(new Event("theme")));
  }, []);

  const user = session && session.user;
  useEffect(() => {
    const main = document.getElementById("main");
    if (main && document.activeElement === document.body) main.focus(); // the form that had the focus is gone
  }, [user]);

  if (!session || !view) return html`<p class="loading" role="status">Loading …</p>`;
  if (!session.user) return html`<main><${SignIn} onSession=${setSession} /></main>`;
  const signOut = () => call("DELETE", "v1/session").then(ask);
  return html`<${Header} session=${session} path=${view.path} onSignOut=${signOut} />
    <main id="main" tabindex="-1"><${view.View} key=${view.path} ids=${view.ids} search=${view.search} session=${session} /></main>`;
}

render(html`<${App} />`, document.getElementById("app"));
