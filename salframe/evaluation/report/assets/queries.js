// The list of queries with its filters. Rows are created when they come near the screen. Keys move through the list.

const CHUNK = 60; // number of rows that are created at a time
let filtered = []; // indices of the queries that pass the filters

function passes(i) {
  const set = currentSet(),
    answers = answersOf(selection.arm);
  if (selection.outcome !== null && answers.outcome[i] !== selection.outcome) return false;
  if (selection.truth !== null && set.truth[i] !== selection.truth) return false;
  if (selection.answer !== null && !(answers.outcome[i] < 2 && answers.place[i] === selection.answer)) return false;
  const text = selection.text.toLowerCase();
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
    oninput: () => updateSelection({text: search.value}),
  });
  const place = make("div", {class: "list scroll"});
  section(
    "queries",
    "Queries",
    make(
      "p",
      {class: "note"},
      "Wrong answers are listed first. Click a row or press Enter to open a query. ↑ and ↓ move through the list. In an " +
        "open query, ← and → open the previous and the next query.",
    ),
    content.pictures
      ? null
      : make(
          "p",
          {class: "notice"},
          "This page has no pictures. To show the panoramas, objects and matches of each query, run: ",
          make("code", {}, `salframe report ${content.runs.map((run) => run.folder).join(" ")}`),
        ),
    make("div", {class: "tools"}, selectionMenus(), filters, search, count),
    place,
  );
  selectionListeners.push(() => {
    const set = currentSet(),
      truths = [...new Set(set.truth)].sort((a, b) => a - b);
    const answered = [...new Set(answersOf(selection.arm).place)].filter((one) => one !== null).sort((a, b) => a - b);
    const outcomes = content.outcomes.map(
      (name, i) => `${name} (${answersOf(selection.arm).outcome.filter((one) => one === i).length})`,
    );
    filters.replaceChildren(
      makeMenu(
        "outcome",
        ["all", ...outcomes],
        (i) => updateSelection({outcome: i ? i - 1 : null}),
        selection.outcome === null ? 0 : selection.outcome + 1,
      ),
      makeMenu(
        "room",
        ["all", ...truths.map(placeName)],
        (i) => updateSelection({truth: i ? truths[i - 1] : null}),
        1 + truths.indexOf(selection.truth),
      ),
      makeMenu(
        "answer",
        ["all", ...answered.map(placeName)],
        (i) => updateSelection({answer: i ? answered[i - 1] : null}),
        1 + answered.indexOf(selection.answer),
      ),
    );
    const answers = answersOf(selection.arm); // wrong answers first; outcome 0 is a correct answer
    const rank = (i) => (answers.outcome[i] ? answers.outcome[i] : content.outcomes.length);
    filtered = set.ids
      .map((_, i) => i)
      .filter(passes)
      .sort((a, b) => rank(a) - rank(b) || a - b);
    count.textContent = `${filtered.length} of ${set.ids.length} queries`;
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
        make("th", {class: "text"}, "true place"),
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
  let numRows = 0;
  const addRows = () => {
    for (const i of filtered.slice(numRows, numRows + CHUNK)) body.append(rowOf(set, i, arms));
    numRows = Math.min(numRows + CHUNK, filtered.length);
  };
  addRows();
  if (numRows < filtered.length) {
    const observer = new IntersectionObserver(
      (entries) => {
        while (
          entries.some((entry) => entry.isIntersecting) &&
          numRows < filtered.length &&
          end.getBoundingClientRect().top < innerHeight + 800
        )
          addRows();
        if (numRows >= filtered.length) observer.disconnect();
      },
      {rootMargin: "800px"},
    );
    observer.observe(end);
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
  const answers = answersOf(selection.arm),
    outcome = answers.outcome[i];
  const fixed = (value, digits) => (value === null ? "–" : value.toFixed(digits));
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
    make("td", {class: "wide"}, fixed(answers.translation_m[i], 2)),
    make("td", {class: "wide"}, fixed(answers.rotation_deg[i], 1)),
    make("td", {class: "text dots wide"}, dots),
  );
}
