// The list of queries: filters, rows that are made as they come near the screen, and moving through it by keys.

const CHUNK = 60;
let listed = []; // positions of the queries that pass the filters

function passes(i) {
  const set = asked(),
    answers = answersOf(looked.arm);
  if (looked.outcome !== null && answers.outcome[i] !== looked.outcome) return false;
  if (looked.truth !== null && set.truth[i] !== looked.truth) return false;
  if (looked.answer !== null && !(answers.outcome[i] < 2 && answers.place[i] === looked.answer)) return false;
  const text = looked.text.toLowerCase();
  return (
    !text ||
    [set.ids[i], placeName(set.truth[i]), placeName(answers.place[i])].some((one) => one.toLowerCase().includes(text))
  );
}

function showQueries() {
  if (!sets.some((set) => armsOf(set).length)) return;
  const filters = make("span", {class: "tools", style: "margin: 0"}),
    count = make("span", {class: "note", role: "status"});
  const search = make("input", {
    type: "search",
    placeholder: "query or place",
    "aria-label": "Search queries",
    oninput: () => look({text: search.value}),
  });
  const place = make("div", {class: "list scroll"});
  section(
    "queries",
    "Queries",
    make(
      "p",
      {class: "note"},
      "Wrong answers come first. Open a query by a click or Enter; ↑ and ↓ move through the list, ← and → to the next query.",
    ),
    content.pictures
      ? null
      : make(
          "p",
          {class: "notice"},
          "This page has no pictures. To look at the panoramas, objects and matches of each query: ",
          make("code", {}, `salframe report ${content.runs.map((run) => run.folder).join(" ")}`),
        ),
    make("div", {class: "tools"}, choosers(), filters, search, count),
    place,
  );
  watchers.push(() => {
    const set = asked(),
      truths = [...new Set(set.truth)].sort((a, b) => a - b);
    const named = [...new Set(answersOf(looked.arm).place)].filter((one) => one !== null).sort((a, b) => a - b);
    const outcomes = content.outcomes.map(
      (name, i) => `${name} (${answersOf(looked.arm).outcome.filter((one) => one === i).length})`,
    );
    filters.replaceChildren(
      choose(
        "outcome",
        ["all", ...outcomes],
        (i) => look({outcome: i ? i - 1 : null}),
        looked.outcome === null ? 0 : looked.outcome + 1,
      ),
      choose(
        "room",
        ["all", ...truths.map(placeName)],
        (i) => look({truth: i ? truths[i - 1] : null}),
        1 + truths.indexOf(looked.truth),
      ),
      choose(
        "answer",
        ["all", ...named.map(placeName)],
        (i) => look({answer: i ? named[i - 1] : null}),
        1 + named.indexOf(looked.answer),
      ),
    );
    const answers = answersOf(looked.arm); // wrong answers first: outcome 0 is a correct answer
    const rank = (i) => (answers.outcome[i] ? answers.outcome[i] : content.outcomes.length);
    listed = set.ids.map((_, i) => i).filter(passes).sort((a, b) => rank(a) - rank(b) || a - b);
    count.textContent = `${listed.length} of ${set.ids.length} queries`;
    place.replaceChildren(listOf(set));
  });
}

function listOf(set) {
  const arms = armsOf(set),
    body = make("tbody", {});
  const dots = make(
    "th",
    {class: "text wide", title: arms.map((arm) => content.arms[arm].name).join(", ")},
    arms.length > 1 ? "all methods" : "",
  );
  const table = make(
    "table",
    {},
    make(
      "thead",
      {},
      make(
        "tr",
        {},
        make("th", {class: "text"}, "query"),
        make("th", {class: "text"}, "place"),
        make("th", {class: "text"}, "answer"),
        make("th", {class: "text"}, "outcome"),
        make("th", {class: "wide"}, "error m"),
        make("th", {class: "wide"}, "error °"),
        dots,
      ),
    ),
    body,
  );
  const end = make("div", {});
  let made = 0;
  const more = () => {
    for (const i of listed.slice(made, made + CHUNK)) body.append(rowOf(set, i, arms));
    made = Math.min(made + CHUNK, listed.length);
  };
  more();
  if (made < listed.length) {
    const watch = new IntersectionObserver(
      (seen) => {
        while (
          seen.some((one) => one.isIntersecting) &&
          made < listed.length &&
          end.getBoundingClientRect().top < innerHeight + 800
        )
          more();
        if (made >= listed.length) watch.disconnect();
      },
      {rootMargin: "800px"},
    );
    watch.observe(end);
  }
  body.addEventListener("keydown", (event) => {
    const row = event.target.closest("tr");
    const next = event.key === "ArrowDown" ? row.nextSibling : event.key === "ArrowUp" ? row.previousSibling : null;
    if (next) {
      event.preventDefault();
      next.focus();
    }
    if (event.key === "Enter") openQuery(Number(row.dataset.query));
  });
  return make("div", {}, table, end);
}

function rowOf(set, i, arms) {
  const answers = answersOf(looked.arm),
    outcome = answers.outcome[i];
  const known = (value, digits) => (value === null ? "–" : value.toFixed(digits));
  const dots =
    arms.length > 1
      ? arms.map((arm) =>
          make(
            "span",
            {
              class: OUTCOME_CLASSES[outcomeOf(i, arm)],
              title: `${content.arms[arm].name}: ${content.outcomes[outcomeOf(i, arm)]}`,
            },
            outcomeOf(i, arm) ? "○" : "●",
          ),
        )
      : "";
  return make(
    "tr",
    {tabindex: 0, "data-query": i, onclick: () => openQuery(i)},
    make("td", {class: "text"}, set.ids[i]),
    make("td", {class: "text"}, placeName(set.truth[i])),
    make("td", {class: "text"}, placeName(answers.place[i])),
    make(
      "td",
      {class: "text"},
      make("span", {class: `outcome ${OUTCOME_CLASSES[outcome]}`}, content.outcomes[outcome]),
      answers.status[i] === "ok" ? "" : ` ${answers.status[i]}`,
    ),
    make("td", {class: "wide"}, known(answers.translation_m[i], 2)),
    make("td", {class: "wide"}, known(answers.rotation_deg[i], 1)),
    make("td", {class: "text dots wide"}, dots),
  );
}
