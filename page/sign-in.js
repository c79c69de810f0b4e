// SPDX-License-Identifier: Apache-2.0
// The form that takes a token once. The service answers with a cookie that scripts cannot read.
import {html, useEffect, useRef, useState} from "./preact.js";
import {call} from "./api.js";
import {Trouble, useAction, useTitle} from "./parts.js";

export function SignIn({onSession}) {
  const [token, setToken] = useState("");
  const field = useRef(null);
  useTitle("Sign in");
  useEffect(() => field.current.focus(), []); // browsers obey autofocus only once in a page
  const [signIn, error, busy] = useAction(async () => onSession(await call("POST", "v1/session", {token: token.trim()})));
  return html`<form class="sign-in card" onSubmit=${e => {
    e.preventDefault();
    signIn();
  }}>
    <img src="page/icon.svg" alt="" width="48" height="48" />
    <h1>hexad</h1>
    <label for="token">Your token</label>
    <input id="token" ref=${field} type="password" autocomplete="current-password" required placeholder="hexad_…"
      value=${token} onInput=${e => setToken(e.target.value)} />
    <p class="hint">An administrator makes one with <code>hexadctl token add NAME [--file FILE]</code>.</p>
    <${Trouble} error=${error} />
    <button class="main" disabled=${busy}>Sign in</button>
  </form>`;
}
