"""Values that somebody, some day, writes where something else belongs: as YAML text, as XML attributes, as names."""

from __future__ import annotations


def words(text: str) -> tuple[str, ...]:
    """Words of a text."""
    return tuple(text.split())


NUMBERS = (
    *words("""0 -0.0 1 -1 1e-3 0.1 3 1e6 -1e6 1e9 1e10 1e11 1e100 1e200 1e308 -1e308 1e309 5e-324 -5e-324 1e-308
        1e-30 1e-16 1e-15 2.5 18446744073709551616 9223372036854775807 -9223372036854775808 2147483648"""),
    *("1" + "0" * 400, "1" * 5000),
)
YAML_NUMBERS = (
    *NUMBERS,
    *words(".nan .inf -.inf .NaN nan inf +.inf 1_000 0x1F 0o17 0b11 1e + -"),
)
XML_NUMBERS = (
    *NUMBERS,
    *words("nan inf -inf NaN 1e 0x10 --1"),
    *("1,5", "1.0.0", "", " ", "abc", "1 2 3 4 5 6 7 8 9", "é"),
)

SCALARS = (
    *words("""0x_ 0b 0b_ 0o9 0o 0x 0xg 0o_ 1:2:3 190:20:30.15 1:60 01 1__0 _1 ._ .e1 2001-12-14
        2001-12-14t21:59:43.10-05:00 2001-13-40 0000-00-00"""),
    *("2024-02-30 25:61:61", "9999-12-31 23:59:60", "null", "~", "", "true", "no", "Off", "off", '""', "''", '" "'),
    *('"\\0"', '"\\uD800"', '"\\x85\\u2028"', '"a\\nb"', '"é"', "'" + "x" * 300 + "'", '"\\e[31m"', "=", "<<", "-"),
    *("?", "@a", "`a`", "%a", "!a", "&a", "*a", "|", ">", "[", "]", "{", "}", ",", "'off'"),
    *words("impact end x robot object base_x"),
    *("'robot/base'", "'../..'", "/", "'/etc/passwd'", ".", '"\\U0001F600"', "'%s%n'", "'{0}'", "'$HOME'", '"\\r"'),
    *("日本語", "'a: b'", "'#'"),
)
TAGS = (
    *("!!bool", "!!int", "!!float", "!!null", "!!str", "!!seq", "!!map", "!!set", "!!omap", "!!pairs", "!!binary"),
    *("!!timestamp", "!!merge", "!!value", "!!python/object:os.system", "!!python/name:os.system"),
    *("!!python/tuple", "!!python/object/apply:os.system", "!local", "!<tag:yaml.org,2002:int>", "!<>", "!!", "!"),
    *("!!float_", "!e!int"),
)
TAGGED = (
    *("maybe", "x", '""', "[1, 2]", "{a: 1}", "0x_", "2001-99-99", "[a, b, a]", "{a, b, a}", "[{a: 1}, {a: 2}]"),
    *("~", "1", "'****'", "aGVsbG8", "aGVsbG8=", "[{a: 1, b: 2}]", "{? [a] : 1}", "['echo x']", "1:2:x", "1e"),
    *(".nan", "!!int 3", "é"),
)
STRUCTURES = (
    *("[]", "{}", "[[]]", "[{}]", "{a: {}}", "[1, a, {b: c}]", "[null]", "{null: null}", "{1: 2}", "{1.5: 2}"),
    *("{true: 1}", "{[1, 2]: 3}", "{{a: b}: c}", "{? : 1}", "{a: 1, a: 2}", "{2001-01-01: 1}", "{.nan: 1}"),
    *("{'': 1}", "{'a.b': 1}", "&r [*r]", "&r {a: *r}", "*nowhere", "{<<: 3}", "{<<: [1]}", "{<<: *nowhere}"),
    *("{<<: {a: 1}}", "{<<: [{a: 1}, {a: 2}]}", "[&a 1, *a, *a]", "{&k a: 1, b: *k}", "{*k : 1}"),
    *("{<<: &s {<<: *s}}", "&a &b 1", "[a: 1, b: 2]", "[1, , 2]", "[1 2", "{a: 1", "&a [&b [&c [1, 1], *c], *b]"),
    *("!!set {a, b}", "!!omap [a: 1, b: 2]", "!!set {? [a]}", "{{}: 1}", "{[]: 1}"),
)
DEEP = (
    *("[" * 60 + "]" * 60, "[" * 3000, "[" * 900 + "1" + "]" * 900, "{a: " * 400 + "1" + "}" * 400, "{a: " * 3000),
    "- " * 2000,
)
KEYS = (
    *("", "~"),
    *words("1 1.5 true .nan 2001-01-01"),
    *("<<", "'a.b'", "é", "²", "?", "? [a, b]", "'" + "k" * 300 + "'", '"a\\nb"', "!!int x", "!!int 3", "&k key"),
    *("*nokey", "{a: b}", "[a]"),
    *words("- name kind extends 0"),
    '"\\0"',
)
