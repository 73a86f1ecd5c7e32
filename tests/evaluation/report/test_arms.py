from __future__ import annotations

from types import SimpleNamespace

from salframe.evaluation.report.arms import Entry, find_entries, find_varied, name_arms, short_key
from salframe.evaluation.report.view import RunView
from salframe.framework.components.settings import flatten


def view(methods, data=None, task="localization"):
    request = {"task": {"name": task}, "data": {"kind": "rooms", "seed": 0, **(data or {})}, "methods": methods}
    records = [SimpleNamespace(label=label) for label in methods]
    return RunView(SimpleNamespace(request=request), records)


def names(*views):
    entries = find_entries(views)
    return [arm.name for arm in name_arms(views, entries, [None] * len(entries))]


def test_settings_that_differ_are_found():
    settings = [{"kind": "a", "k": 1, "deep.x": 1}, {"kind": "a", "k": 2, "deep.x": 1}, {"kind": "a", "k": 2}]
    assert find_varied(settings, ["a"] * 3) == ["k", "deep.x"]
    assert find_varied(settings, ["a", "b", "c"]) == []


def test_below_another_component_its_settings_do_not_differ():
    plain = {"kind": "m", "slot": {"kind": "small", "size": 1}}
    large, larger = ({"kind": "m", "slot": {"kind": "large", "width": width}} for width in (2, 3))
    assert find_varied([flatten(one) for one in (plain, large)], ["m", "m"]) == ["slot.kind"]
    assert find_varied([flatten(one) for one in (plain, large, larger)], ["m"] * 3) == ["slot.kind", "slot.width"]


def test_keys_are_as_short_as_tells_them_apart():
    keys = ["graph.top_k", "matcher.top_k", "matcher.kind", "agreement"]
    assert [short_key(key, keys) for key in keys] == ["graph.top_k", "matcher.top_k", "matcher", "agreement"]
    assert short_key("graph.top_k", ["graph.top_k", "agreement"]) == "top_k"


def test_an_ablation_has_a_column_for_each_setting_and_short_names():
    run = view(
        {
            f"m[one.a={a},two.b={b}]": {"kind": "m", "one": {"a": a}, "two": {"b": b}}
            for a in (1, 2)
            for b in (True, False)
        }
    )
    entries = find_entries([run])
    arms = name_arms([run], entries, [None] * 4)
    assert [arm.name for arm in arms] == ["m", "b=false", "a=2", "a=2 b=false"]
    assert [arm.base for arm in arms] == ["m"] * 4
    assert arms[3].varied == {"one.a": "2", "two.b": "false"}


def test_runs_on_other_seeds_are_one_arm():
    methods = {"m": {"kind": "m"}, "n": {"kind": "n"}}
    runs = [view(methods), view(methods, {"seed": 1}), view({"m": {"kind": "m"}}, {"seed": 2})]
    assert find_entries(runs) == [(Entry(0, 0), Entry(1, 0), Entry(2, 0)), (Entry(0, 1), Entry(1, 1))]


def test_what_was_run_twice_counts_once():
    assert find_entries([view({"m": {"kind": "m"}}), view({"n": {"kind": "n"}, "m": {"kind": "m"}})]) == [
        (Entry(0, 0),),
        (Entry(1, 0),),
    ]


def test_a_method_under_other_settings_or_on_other_data_is_another_arm():
    assert names(view({"m": {"kind": "m", "k": 1}}), view({"m": {"kind": "m", "k": 2}})) == ["m", "k=2"]
    assert names(view({"m": {"kind": "m"}}), view({"m": {"kind": "m"}}, {"rooms": 7})) == ["m", "rooms=7"]
    both = view({"m": {"kind": "m"}, "n": {"kind": "n"}}, {"rooms": 6})
    assert names(both, view({"m": {"kind": "m"}}, {"rooms": 7})) == ["m", "n", "m rooms=7"]
