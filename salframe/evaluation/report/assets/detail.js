// One query, opened: what was asked, what each method answered, and how its score came about.

const dialog = document.getElementById("detail");
const opened = {i: null, kind: "answer"};

function openQuery(i) {
  opened.i = i;
  history.replaceState(null, "", `#q${looked.set}-${i}`);
  opened.kind = "answer";
  paintDetail();
  if (!dialog.open) dialog.showModal();
  dialog.scrollTop = 0;
  dialog.focus();
}

// The next query of the list, or the one before.
function step(by) {
  const next = listed[listed.indexOf(opened.i) + by];
  if (next !== undefined) openQuery(next);
}

dialog.addEventListener("keydown", (event) => {
  if (event.target.matches("select, input")) return;
  if (event.key === "ArrowRight") step(1);
  if (event.key === "ArrowLeft") step(-1);
});
dialog.addEventListener("click", (event) => {
  if (event.target === dialog) dialog.close();
});
dialog.addEventListener("close", () => {
  history.replaceState(null, "", "#queries");
  const row = document.querySelector(`#queries tr[data-query="${opened.i}"]`);
  if (row) row.focus();
});
addEventListener("resize", () => {
  if (dialog.open) paintDetail();
});

function paintDetail() {
  const set = asked(),
    i = opened.i,
    arms = armsOf(set),
    position = listed.indexOf(i);
  const text = island(`q${looked.set}-${i}`),
    query = text ? JSON.parse(text) : {objects: {}, arms: {}};
  const top = make(
    "div",
    {class: "top"},
    make("h2", {}, `${set.ids[i]}, taken in ${placeName(set.truth[i])}`),
    choose(
      "method",
      arms.map((arm) => content.arms[arm].name),
      (k) => {
        look({arm: arms[k]});
        paintDetail();
      },
      arms.indexOf(looked.arm),
    ),
    make(
      "button",
      {type: "button", onclick: () => step(-1), disabled: position < 1, "aria-label": "The query before"},
      "←",
    ),
    make("span", {class: "note"}, position < 0 ? "" : `${position + 1} of ${listed.length}`),
    make(
      "button",
      {
        type: "button",
        onclick: () => step(1),
        disabled: position < 0 || position === listed.length - 1,
        "aria-label": "The next query",
      },
      "→",
    ),
    make("button", {type: "button", onclick: () => dialog.close(), "aria-label": "Close"}, "✕"),
  );
  const known = query.arms[looked.arm];
  dialog.replaceChildren(
    top,
    make(
      "div",
      {class: "inside"},
      known
        ? showMatch(set, i, query, known)
        : text
          ? make("p", {class: "note"}, "Nothing is known of how this method answered.")
          : null,
      make("h3", {}, "What each method answered"),
      answersTable(set, i, arms),
    ),
  );
}

function showMatch(set, i, query, known) {
  const match = known.references.find((one) => one.kind === opened.kind) || known.references[0];
  const asks = {url: island(`pq${looked.set}-${i}`), objects: query.objects[known.describer]};
  if (!match)
    return make(
      "div",
      {},
      pairOf(asks, {url: null, objects: null}, {}, true),
      make("p", {class: "note"}, "The method answered no place."),
    );
  const frame = JSON.parse(island(`f${looked.set}-${match.frame}`));
  const reference = {
    url: island(`pf${looked.set}-${match.frame}`),
    objects: frame.objects[known.describer],
    pose: frame.pose,
  };
  const kinds =
    known.references.length < 2
      ? null
      : known.references.map((one) =>
          make(
            "button",
            {
              type: "button",
              "aria-pressed": String(one === match),
              onclick: () => {
                opened.kind = one.kind;
                paintDetail();
              },
            },
            one.kind === "answer" ? "the place answered" : "the true place",
          ),
        );
  const estimated = answersOf(looked.arm).pose[i],
    truth = set.poses[i],
    pose = estimated || truth;
  const matched = match.points
    ? `${match.matched} points matched${match.matched > match.points.length ? `, ${match.points.length} drawn` : ""}`
    : match.pairs
      ? `${match.pairs.length} of ${sizeOfObjects(asks.objects)} objects matched`
      : "the method matches neither points nor objects";
  const floor = set.floors.find((one) => one.places.includes(frame.place)) || null;
  const shapes = asks.objects && asks.objects.box && reference.objects;
  return make(
    "div",
    {},
    make("div", {class: "tools"}, make("span", {}, `Matched with ${frame.id} in ${frame.place}: ${matched}`), kinds),
    pairOf(asks, reference, match, innerWidth < 900),
    make(
      "div",
      {class: "columns"},
      pose || shapes
        ? make(
            "div",
            {class: "plan"},
            make(
              "h3",
              {},
              estimated
                ? "From above, under the estimated pose"
                : "From above; no pose was estimated, the query stands where it was taken",
            ),
            planOf(asks, reference, match, pose, truth, floor),
            make(
              "p",
              {},
              [
                ["--c0", "query"],
                ["--c1", "map"],
                ["--c2", "truth"],
              ].map(([colour, name]) =>
                make(
                  "span",
                  {class: "key"},
                  make("span", {class: "swatch", style: `background: var(${colour}); margin: 0`}),
                  name,
                ),
              ),
            ),
          )
        : make("div", {}),
      make("div", {}, scoreTable(set, i, known)),
    ),
  );
}

// How the score came about: part by part where the method weighs parts, else its first places.
function scoreTable(set, i, known) {
  const found = known.evidence,
    fixed = (value, digits = 2) => (value === null || value === undefined ? "–" : value.toFixed(digits));
  const answers = answersOf(looked.arm);
  const ranked = make(
    "table",
    {},
    make(
      "thead",
      {},
      make("tr", {}, make("th", {class: "text"}, "place"), make("th", {}, "score"), make("th", {}, "probability")),
    ),
    make(
      "tbody",
      {},
      answers.ranked[i].map(([place, score, chance]) =>
        make(
          "tr",
          {},
          make("td", {class: "text"}, place),
          make("td", {}, fixed(score, 3)),
          make("td", {}, chance === null ? "–" : `${(100 * chance).toFixed(1)} %`),
        ),
      ),
      answers.out_of_map_probability[i] === null
        ? null
        : make(
            "tr",
            {},
            make("td", {class: "text"}, "out of map"),
            make("td", {}, ""),
            make("td", {}, `${(100 * answers.out_of_map_probability[i]).toFixed(1)} %`),
          ),
    ),
  );
  const first = [make("h3", {}, "First places"), ranked];
  if (!found) return first;
  const total = (place) => place.values.reduce((sum, value, k) => sum + value * found.weights[k], 0);
  const table = make(
    "table",
    {},
    make(
      "thead",
      {},
      make(
        "tr",
        {},
        make("th", {class: "text"}, "part × weight"),
        make("th", {}, "weight"),
        found.places.map((place) => [make("th", {}, place.place), make("th", {}, "× weight")]),
      ),
    ),
    make(
      "tbody",
      {},
      found.parts.map((part, k) =>
        make(
          "tr",
          {},
          make("td", {class: "text"}, part.replaceAll("_", " ")),
          make("td", {}, fixed(found.weights[k])),
          found.places.map((place) => [
            make("td", {}, fixed(place.values[k])),
            make("td", {class: "lead"}, fixed(place.values[k] * found.weights[k])),
          ]),
        ),
      ),
      make(
        "tr",
        {},
        make("td", {class: "text lead"}, "sum"),
        make("td", {}, ""),
        found.places.map((place) => [make("td", {}, ""), make("td", {class: "lead"}, fixed(total(place)))]),
      ),
    ),
  );
  return [
    make("h3", {}, "How the score came about"),
    make("div", {class: "scroll"}, table),
    make("p", {class: "note"}, "Of each place its best hypothesis; a place's score joins all of them."),
    ...first,
  ];
}

function answersTable(set, i, arms) {
  const rows = arms.map((arm) => {
    const answers = answersOf(arm),
      outcome = answers.outcome[i],
      known = (value, digits) => (value === null ? "–" : value.toFixed(digits));
    const pick = () => {
      look({arm});
      paintDetail();
    };
    return make(
      "tr",
      {
        class: arm === looked.arm ? "pick chosen" : "pick",
        tabindex: 0,
        onclick: pick,
        onkeydown: (event) => {
          if (event.key === "Enter") pick();
        },
      },
      make("td", {class: "text"}, content.arms[arm].name),
      make("td", {class: "text"}, placeName(answers.place[i])),
      make(
        "td",
        {class: "text"},
        make("span", {class: `outcome ${OUTCOME_CLASSES[outcome]}`}, content.outcomes[outcome]),
      ),
      make("td", {class: "text"}, [answers.status[i], answers.error[i]].filter(Boolean).join(": ")),
      make("td", {}, answers.ranked[i][0] ? known(answers.ranked[i][0][1], 3) : "–"),
      make(
        "td",
        {class: "text"},
        answers.ranked[i][1] ? `${answers.ranked[i][1][0]} ${known(answers.ranked[i][1][1], 3)}` : "–",
      ),
      make("td", {}, known(answers.translation_m[i], 2)),
      make("td", {}, known(answers.rotation_deg[i], 1)),
      make("td", {}, known(answers.ms[i], 0)),
    );
  });
  return make(
    "div",
    {class: "scroll"},
    make(
      "table",
      {},
      make(
        "thead",
        {},
        make(
          "tr",
          {},
          ["method", "answer", "outcome", "status"].map((name) => make("th", {class: "text"}, name)),
          make("th", {}, "score"),
          make("th", {class: "text"}, "runner-up"),
          ["error m", "error °", "ms"].map((name) => make("th", {}, name)),
        ),
      ),
      make("tbody", {}, rows),
    ),
  );
}
