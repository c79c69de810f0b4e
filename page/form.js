// SPDX-License-Identifier: Apache-2.0
// A form made from a JSON Schema, as far as specs of jobs need it. What it cannot show is edited as JSON.
import {html, useState} from "./preact.js";
import {countOf} from "./words.js";

const RANKS = ["basic", "advanced", "research"];

/** The names of members, basic ones first. */
export const byRank = (names, properties) =>
  names.map(name => [RANKS.indexOf(properties[name]["x-rank"]), name]).sort(([a], [b]) => a - b).map(([, name]) => name);

const wordOf = name => (name ? name[0].toUpperCase() + name.slice(1).replace(/_/g, " ") : "");

/** What a form calls a member: its title in the table of the spec, or its name. */
export const titleOf = (name, schema) => schema && schema.title || wordOf(name);

/** The members of which exactly one is given; the schema says so by oneOf with required. */
function choicesOf(schema) {
  for (const rule of schema.allOf || [])
    if (rule.oneOf && rule.oneOf.every(way => way.required && way.required.length === 1)) return rule.oneOf.map(way => way.required[0]);
  return [];
}

/** The name of the constant member by which variants differ. */
const discriminatorOf = schema => {
  const first = schema.oneOf && schema.oneOf[0].properties;
  return first && Object.keys(first).find(name => schema.oneOf.every(way => way.properties && way.properties[name] && "const" in way.properties[name]));
};

/** A value that satisfies the schema as far as one can guess: its defaults, and 1 for numbers that have none. */
export function blankOf(schema) {
  if ("const" in schema) return schema.const;
  if ("default" in schema) return schema.default;
  if (schema.enum) return schema.enum[0];
  if (schema.oneOf) return blankOf(schema.oneOf[0]);
  if (schema.$ref) return {}; // a surface within a surface
  if (schema.type === "object") {
    const names = [...(schema.required || []), ...choicesOf(schema).slice(0, 1)];
    return Object.fromEntries(names.map(name => [name, blankOf(schema.properties[name])]));
  }
  if (schema.type === "array") return Array.from({length: schema.minItems || 0}, () => blankOf(schema.items));
  if (schema.type === "boolean") return false;
  if (schema.type === "string") return "";
  return Math.max(1, schema.minimum ?? 1);
}

function without(object, name) {
  const rest = {...object};
  delete rest[name];
  return rest;
}

const isNumber = schema => schema.type === "number" || schema.type === "integer";
const rangeOf = ({minimum, exclusiveMinimum, maximum}) => {
  const low = minimum ?? exclusiveMinimum;
  const far = value => value === undefined || Math.abs(value) >= 1e9;
  const show = value => (Number.isInteger(value) ? countOf(value) : value);
  return far(low) && far(maximum) ? "" : `${far(low) ? "up" : `${exclusiveMinimum !== undefined ? "above " : "from "}${show(low)}`}${far(maximum) ? "" : ` to ${show(maximum)}`}`;
};

function NumberInput({schema, value, onChange, ...more}) {
  return html`<input type="number" ...${more} step=${schema.type === "integer" ? 1 : "any"} min=${schema.minimum} max=${schema.maximum}
    placeholder=${schema.default ?? ""} value=${value ?? ""} onInput=${e => onChange(e.target.value === "" ? undefined : Number(e.target.value))} />`;
}

/** Text that is JSON. Other text makes the field invalid, so that the browser does not submit the form. */
function JsonInput({value, onChange, ...more}) {
  const [text, setText] = useState(value === undefined ? "" : JSON.stringify(value));
  return html`<input ...${more} value=${text} onInput=${({target}) => {
    setText(target.value);
    target.setCustomValidity("");
    try {
      onChange(target.value.trim() === "" ? undefined : JSON.parse(target.value));
    } catch (error) {
      target.setCustomValidity(`Invalid JSON: ${error.message}`);
    }
  }} />`;
}

function Input({schema, value, onChange, ...more}) {
  if (schema.enum) return html`<select ...${more} value=${value ?? schema.default ?? ""} onChange=${e => onChange(e.target.value === schema.default ? undefined : e.target.value)}>
    ${schema.enum.map(word => html`<option value=${word} selected=${word === (value ?? schema.default)}>${word}</option>`)}</select>`;
  if (schema.type === "boolean") return html`<input type="checkbox" ...${more} checked=${value ?? schema.default} onChange=${e => onChange(e.target.checked)} />`;
  if (isNumber(schema)) return html`<${NumberInput} ...${more} schema=${schema} value=${value} onChange=${onChange} />`;
  if (schema.type === "string") return html`<input ...${more} maxlength=${schema.maxLength} value=${value ?? ""} onInput=${e => onChange(e.target.value || undefined)} />`;
  if (schema.type === "array" && schema.items && isNumber(schema.items) && schema.maxItems === schema.minItems && schema.maxItems <= 4) {
    const all = value || schema.default || [];
    return html`<span class="vector">${Array.from({length: schema.maxItems}, (_, i) => html`<${NumberInput} ...${more} id=${i ? null : more.id} aria-label=${`${more.word} ${i + 1}`}
      schema=${{...schema.items, default: (schema.default || [])[i]}} value=${all[i]} onChange=${next => {
        const changed = Array.from({length: schema.maxItems}, (__, k) => (k === i ? next : all[k]) ?? 0);
        onChange(changed);
      }} />`)}</span>`;
  }
  if (schema.type === "array" && schema.items && schema.items.type === "string")
    return html`<input ...${more} placeholder="separated by commas" value=${(value || []).join(", ")}
      onChange=${e => onChange(e.target.value.split(",").map(word => word.trim()).filter(Boolean))} />`;
  return html`<${JsonInput} ...${more} placeholder="JSON" value=${value} onChange=${onChange} />`;
}

/** One value with its name, help, range and faults. */
function Field({name, schema, value, pointer, faults, required, onChange}) {
  const id = `f${pointer}`, fault = faults.get(pointer), word = titleOf(name, schema);
  const help = [schema.description, rangeOf(schema), schema.default !== undefined && `default ${JSON.stringify(schema.default)}`].filter(Boolean).join(" · ");
  return html`<div class="field"><label for=${id}>${word}${required ? " *" : ""}</label>
    <${Input} id=${id} word=${word} schema=${schema} value=${value} onChange=${onChange} aria-invalid=${fault ? "true" : null} aria-describedby=${`${id}-help`} />
    <p class="hint" id=${`${id}-help`}>${help}</p>${fault && html`<p class="fault" role="alert">${fault}</p>`}</div>`;
}

/** A value of any schema. */
export function Node({name, schema, value, pointer, faults, required, onChange}) {
  const discriminator = discriminatorOf(schema);
  if (discriminator) return html`<${Variants} ...${{name, schema, value, pointer, faults, onChange, discriminator}} />`;
  if (schema.type !== "object" || !schema.properties) return html`<${Field} ...${{name, schema, value, pointer, faults, required, onChange}} />`;
  return html`<${Members} ...${{schema, value, pointer, faults, onChange}} />`;
}

function Variants({name, schema, value, pointer, faults, onChange, discriminator}) {
  const chosen = schema.oneOf.find(way => value && way.properties[discriminator].const === value[discriminator]) || schema.oneOf[0];
  return html`<div class="field"><label for=${`v${pointer}`}>${wordOf(discriminator)}</label>
    <select id=${`v${pointer}`} onChange=${e => onChange(blankOf(schema.oneOf[e.target.selectedIndex]))}>${schema.oneOf.map(way =>
      html`<option selected=${way === chosen}>${way.properties[discriminator].const}</option>`)}</select></div>
    <${Members} key=${chosen.properties[discriminator].const} ...${{schema: chosen, value, pointer, faults, onChange}} />`;
}

/**
 * The members of an object, basic ones first. Optional members that are not basic and have no value are below "More". They
 * stay there, so that no field moves while the user types.
 */
function Members({schema, value = {}, pointer, faults, onChange}) {
  const choices = byRank(choicesOf(schema), schema.properties), given = choices.find(name => name in value) || choices[0];
  const others = byRank(Object.keys(schema.properties).filter(name => !choices.includes(name)), schema.properties);
  const [late] = useState(() => {
    const absent = others.filter(name => !(schema.required || []).includes(name) && !(name in value) && schema.properties[name]["x-rank"] !== RANKS[0]);
    return choices.length || absent.length < others.length ? absent : [];
  });
  const member = name => {
    const part = schema.properties[name], at = `${pointer}/${name}`;
    if ("const" in part) return null;
    const set = next => onChange(next === undefined ? without(value, name) : {...value, [name]: next});
    const required = (schema.required || []).includes(name) || name === given;
    const node = html`<${Node} key=${name} name=${name} schema=${part} value=${value[name]} pointer=${at} faults=${faults} required=${required} onChange=${set} />`;
    if (part.type !== "object" || !part.properties || name === given) return node;
    return html`<${Optional} key=${name} name=${name} schema=${part} value=${value[name]} onChange=${set}>${node}<//>`;
  };
  const choose = name => onChange({...Object.fromEntries(Object.entries(value).filter(([key]) => !choices.includes(key))), [name]: blankOf(schema.properties[name])});
  return html`${choices.length > 0 && html`<div class="field"><label for=${`c${pointer}`}>Given by</label>
      <select id=${`c${pointer}`} onChange=${e => choose(e.target.value)}>${choices.map(name => html`<option value=${name} selected=${name === given}>${titleOf(name, schema.properties[name])}</option>`)}</select>
      ${schema.properties[given].properties && html`<p class="hint">${schema.properties[given].description}</p>`}</div>${member(given)}`}
    ${others.filter(name => !late.includes(name)).map(member)}
    ${late.length > 0 && html`<details class="group" open=${late.some(name => name in value)}><summary>More: ${late.map(name => titleOf(name, schema.properties[name])).join(", ")}</summary>
      <div class="fields">${late.map(member)}</div></details>`}`;
}

/** A group that may be absent. */
function Optional({name, schema, value, onChange, children}) {
  return html`<details class="group" open=${value !== undefined}><summary>${titleOf(name, schema)}</summary><p class="hint">${schema.description}
    ${value !== undefined && html` <button type="button" class="plain" onClick=${() => onChange(undefined)}>Leave out</button>`}</p>
    <div class="fields">${children}</div></details>`;
}
