"""Checks of observed births, aliases, metrics and their properties."""

from collections import defaultdict

from sparkplug_grading import BIRTHS, DATA, DATA_TYPES, REBIRTH, check, say

# Births.


@check("topics-nbirth-metrics", "topics-dbirth-metrics", "payloads-metric-datatype-req", "payloads-name-requirement")
def births_say_name_type_and_value(seen):
    for each in seen.of(*BIRTHS):
        for metric in each.message.metrics:
            right = metric.name and metric.HasField("datatype") and (metric.WhichOneof("value") or metric.is_null)
            yield say(right, f"{each.topic} {metric.name}")


@check("payloads-metric-datatype-value", "payloads-metric-datatype-value-type")
def types_are_known_ones(seen):
    for each in seen.of(*BIRTHS):
        for metric in each.message.metrics:
            yield say(metric.datatype in DATA_TYPES, f"{metric.name}: {metric.datatype}")


def _null_or_value(kind):
    def of_kind(seen):
        for each in seen.of(kind):
            for metric in each.message.metrics:
                right = metric.is_null == (metric.WhichOneof("value") is None)
                yield say(right, f"{each.topic} {metric.name}")

    return of_kind


check("operational-behavior-data-publish-nbirth-values")(_null_or_value("NBIRTH"))
check("operational-behavior-data-publish-dbirth-values")(_null_or_value("DBIRTH"))


@check(
    "topics-nbirth-metric-reqs", "topics-dbirth-metric-reqs", "operational-behavior-data-publish-nbirth",
    "operational-behavior-data-publish-dbirth",
)  # fmt: skip
def data_has_only_what_a_birth_has_told(seen):
    for session in seen.sessions():
        born = defaultdict(set)
        for each in session:
            aliases = {metric.alias for metric in each.message.metrics if metric.HasField("alias")}
            if each.kind in BIRTHS:
                born[each.device] = aliases
            elif each.kind in DATA:
                yield say(aliases <= born[each.device], f"{each.topic}: {aliases - born[each.device]}")


@check(
    "topics-nbirth-rebirth-metric", "payloads-nbirth-rebirth-req",
    "operational-behavior-data-commands-rebirth-name", "operational-behavior-data-commands-rebirth-name-aliases",
    "operational-behavior-data-commands-rebirth-datatype", "operational-behavior-data-commands-rebirth-value",
)  # fmt: skip
def the_node_can_be_asked_for_its_births(seen):
    for each in seen.of("NBIRTH"):
        metric = each.metric(REBIRTH)
        right = metric is not None and metric.datatype == 11 and not metric.HasField("alias")
        yield say(right and metric.WhichOneof("value") == "boolean_value" and not metric.boolean_value, each.topic)


# Aliases and metrics.


@check("payloads-alias-uniqueness")
def an_alias_is_one_metric(seen):
    known = {}
    for each in seen.of(*BIRTHS):
        for metric in each.message.metrics:
            if metric.HasField("alias"):
                name = each.device, metric.name
                yield say(known.setdefault(metric.alias, name) == name, f"{metric.alias}: {name}")


@check("payloads-alias-birth-requirement")
def births_bind_aliases(seen):
    for each in seen.of(*BIRTHS):
        for metric in each.message.metrics:
            yield say(metric.name and (metric.HasField("alias") or metric.name in (REBIRTH, "bdSeq")), metric.name)


@check("payloads-alias-data-cmd-requirement")
def data_has_aliases_alone(seen):
    for each in seen.of(*DATA):
        for metric in each.message.metrics:
            yield say(metric.HasField("alias") and not metric.name, f"{each.topic} {metric.name}")


@check("payloads-metric-datatype-not-req")
def data_says_no_types(seen):
    for each in seen.of(*DATA):
        for metric in each.message.metrics:
            yield say(not metric.HasField("datatype"), f"{each.topic} {metric.alias}")


@check("payloads-name-birth-data-requirement", "payloads-metric-timestamp-in-UTC")
def metrics_have_times(seen):
    for each in seen.of(*BIRTHS, *DATA):
        for metric in each.message.metrics:
            right = 1_600_000_000_000 < metric.timestamp <= each.message.timestamp + 1000
            yield say(right, f"{each.topic} {metric.name or metric.alias}: {metric.timestamp}")


def _chronological(kinds):
    def of_kinds(seen):
        for each in seen.of(*kinds):
            times = [metric.timestamp for metric in each.message.metrics if not metric.is_historical]
            yield say(times == sorted(times), each.topic)

    return of_kinds


check("operational-behavior-data-publish-nbirth-order")(_chronological(["NBIRTH", "NDATA"]))
check("operational-behavior-data-publish-dbirth-order")(_chronological(["DBIRTH", "DDATA"]))


def _by_exception(kinds):
    """Return a check that a metric is sent only after a change of value or quality.

    Metrics with answers to commands are exempt, and sent each time.
    """

    def of_kinds(seen):
        for session in seen.sessions():
            last, names = {}, {}
            for each in session:
                for metric in each.message.metrics:
                    names.setdefault(metric.alias, metric.name)
                    if metric.is_historical or names[metric.alias].startswith("Answer/"):
                        continue
                    which = metric.WhichOneof("value")
                    quality = [value.int_value or value.boolean_value for value in metric.properties.values[:2]]
                    now = which and getattr(metric, which), quality
                    if each.kind in kinds:
                        yield say(last.get(metric.alias) != now, f"{each.topic} {names[metric.alias]}: {now}")
                    last[metric.alias] = now

    return of_kinds


check("topics-ndata-payload", "operational-behavior-data-publish-nbirth-change")(_by_exception(["NDATA"]))
check("topics-ddata-payload", "operational-behavior-data-publish-dbirth-change", "principles-rbe-recommended")(
    _by_exception(["DDATA"])
)


# Properties.


@check("payloads-propertyset-keys-array-size", "payloads-propertyset-values-array-size")
def property_sets_are_whole(seen):
    for metric in _with_properties(seen):
        yield say(len(metric.properties.keys) == len(metric.properties.values), str(metric.properties.keys))


@check(
    "payloads-metric-propertyvalue-type-req", "payloads-metric-propertyvalue-type-type",
    "payloads-metric-propertyvalue-type-value",
)  # fmt: skip
def properties_say_their_types(seen):
    for metric in _with_properties(seen):
        for value in metric.properties.values:
            yield say(value.HasField("type") and value.type in DATA_TYPES, str(value))


@check("payloads-propertyset-quality-value-type", "payloads-propertyset-quality-value-value")
def quality_is_one_of_three(seen):
    for metric in _with_properties(seen):
        said = dict(zip(metric.properties.keys, metric.properties.values, strict=True))
        if "Quality" in said:
            value = said["Quality"]
            yield say(value.type == 3 and value.int_value in (0, 192, 500), str(value))


def _with_properties(seen):
    for each in seen.of(*BIRTHS, *DATA):
        yield from (metric for metric in each.message.metrics if metric.HasField("properties"))
