"""Message definitions in ROS 2's IDL (`ros2idl`) as `ros2msg` texts, by a parser that takes each word once.

Language: OMG IDL 4.2, as https://design.ros2.org/articles/idl_interface_definition.html uses it; a recording has the
definitions of a type one after the other, each behind a line of `=` and a line `IDL: package/msg/Name`. Comments, and
annotations such as `@verbatim`, `@default`, `@unit` and `@key`, which ROS writes, do not change the bytes of a message;
those that may are not read.
"""

from __future__ import annotations

import re
from collections.abc import Collection, Iterator, Sequence
from typing import NamedTuple, TypeVar

from cwcli.logs.codecs.ros2msg import MAX_DIGITS_OF_ARRAY_LENGTH, STRING_TYPE, WSTRING_TYPE, SchemaError

MAX_IDL_CHARACTERS = 1 << 18
"""The definitions of a type have at most 256 Ki characters. Chosen by hand, as for ROS 1."""
MAX_ROS2MSG_CHARACTERS = 1 << 20
"""Greatest length of the `ros2msg` text of one definition, 1 Mi characters. Chosen by hand: ROS's own texts are shorter
than their IDL."""
MAX_NAME_CHARACTERS = 255
"""Greatest length of a name with its modules, 255 characters. Chosen by hand: ROS makes names of files of them."""
MAX_MODULE_DEPTH = 16
"""Greatest number of modules inside each other. Chosen by hand: ROS has two or three."""
MAX_TYPEDEF_DEPTH = 16
"""Greatest number of typedefs that lead from one name to a type. Chosen by hand: ROS has two."""
BYTE_CHANGING_ANNOTATIONS = frozenset({"optional", "bit_bound", "mutable", "appendable", "extensibility"})
"""A type or a field with one of these annotations may have other bytes (OMG XTypes 1.3, section 7.4)."""
ROS_TYPE_BY_IDL_WORDS = {
    **{each: each for each in ("int8", "uint8", "int16", "uint16", "int32", "uint32", "int64", "uint64")},
    **{"boolean": "bool", "octet": "byte", "char": "uint8", "float": "float32", "double": "float64"},
    **{"short": "int16", "long": "int32", "long long": "int64"},
    **{"unsigned short": "uint16", "unsigned long": "uint32", "unsigned long long": "uint64"},
    **{"string": STRING_TYPE, "wstring": WSTRING_TYPE},
}
"""The words of a type in IDL stand for this primitive type of ROS 2 (the article above, section Types)."""
ENCODED_ROS_TYPE_OF_ENUM = "uint32"
"""An enumerated value is encoded as this type (OMG XTypes 1.3, section 7.4.1)."""
_WORD_PATTERN = re.compile(
    r'\s+|//[^\n]*|/\*(?:.*?\*/|.*)|^#[^\n]*|^={3}[^\n]*\nIDL:[^\n]*|("(?:[^"\\]|\\.)*"?|\'(?:[^\'\\]|\\.)*\'?|\w+|::|.)',
    re.MULTILINE | re.DOTALL,
)
"""The pattern of what is skipped, or of one word of the language; a comment that does not end takes the rest."""

Meaning = TypeVar("Meaning")


class IdlType(NamedTuple):
    """A type: its name, in ROS or as IDL has it, and what stands behind it in `ros2msg` (`[]`, `[3]` or nothing)."""

    name: str
    array: str


def ros2msg_text_of_idl(type_name: str, text: str) -> str:
    """Return the definition of a type with all that it uses in `ros2msg`.

    Raises:
        SchemaError: The text is or becomes too long, can't be understood, or does not define the type.
    """
    if len(text) > MAX_IDL_CHARACTERS:
        raise SchemaError(f"the definition has {len(text):,} characters, more than {MAX_IDL_CHARACTERS:,}")
    parser = _IdlParser(text)
    parser.parse()
    root = type_name.replace("/", "::")
    if root not in parser.structs:
        raise SchemaError(f"the definition in IDL does not define {type_name}")
    text_by_name: dict[str, str] = {}
    waiting = [root]
    n_characters = 0
    while waiting:
        name = waiting.pop()
        if name not in text_by_name and name in parser.structs:
            lines = [f"MSG: {name.replace('::', '/')}\n"] if text_by_name else []
            known: dict[str, IdlType] = {}
            for field_name, declared in parser.structs[name]:
                found = known[declared.name] = known.get(declared.name) or parser.resolve(declared.name, name)
                if declared.array and found.array:
                    raise SchemaError("an array of arrays is not read")
                waiting.append(found.name)
                lines.append(f"{found.name.replace('::', '/')}{found.array or declared.array} {field_name}\n")
                n_characters += len(lines[-1])
                if n_characters > MAX_ROS2MSG_CHARACTERS:
                    raise SchemaError(f"it makes more than {MAX_ROS2MSG_CHARACTERS:,} characters of `ros2msg`")
            text_by_name[name] = "".join(lines)
    return ("=" * 80 + "\n").join(text_by_name.values())


class _IdlParser:
    """The words of a text, and what they define, by names with all modules, joined by `::`."""

    def __init__(self, text: str) -> None:
        self._words: Iterator[str] = (found[1] for found in _WORD_PATTERN.finditer(text) if found[1])
        self._word = next(self._words, "")
        self._modules: list[str] = []
        self.structs: dict[str, list[tuple[str, IdlType]]] = {}
        self.typedefs: dict[str, IdlType] = {}
        self.constants: dict[str, str] = {}

    def parse(self) -> None:
        """Parse all definitions.

        Raises:
            SchemaError: A word is not expected, or a name has two meanings.
        """
        while self._word:
            self._skip_annotations()
            word = self._take()
            if word == "module":
                self._modules.append(self._take_identifier())
                self._take("{")
                if len(self._modules) > MAX_MODULE_DEPTH:
                    raise SchemaError(f"modules are more than {MAX_MODULE_DEPTH} deep inside each other")
            elif word == "}" and self._modules:
                self._modules.pop()
                self._take(";")
            elif word == "struct":
                name = self._take_identifier()
                self._define(self.structs, name, self._take_fields())
            elif word == "typedef":
                for name, kind in self._declarators(self._take_type()):
                    self._define(self.typedefs, name, kind)
            elif word == "const":
                self._take_type()
                name = self._take_identifier()
                self._take("=")
                self._define(self.constants, name, " ".join(self._words_before(";")))
            elif word == "enum":
                self._define(self.typedefs, self._take_identifier(), IdlType(ENCODED_ROS_TYPE_OF_ENUM, ""))
                self._words_before(";")
            else:
                raise SchemaError(f"{word[:40]!r} begins no definition of IDL that is read")

    def resolve(self, name: str, scope: str) -> IdlType:
        """Return the type that a name stands for at last, as seen from a scope.

        Raises:
            SchemaError: It is an array of arrays, or names stand for each other without end.
        """
        array = ""
        for _ in range(MAX_TYPEDEF_DEPTH):
            found = _find_in_scope(name, scope.split("::"), self.typedefs, self.structs)
            if found not in self.typedefs:
                return IdlType(found, array)
            if array and self.typedefs[found].array:
                raise SchemaError("an array of arrays is not read")
            name, array, scope = self.typedefs[found].name, array or self.typedefs[found].array, found
        raise SchemaError(f"more than {MAX_TYPEDEF_DEPTH} names stand for each other")

    def _define(self, meanings: dict[str, Meaning], name: str, meaning: Meaning) -> None:
        """Add the meaning of a name of the module; files of a package may say the same one again."""
        full = "::".join((*self._modules, name))
        if len(full) > MAX_NAME_CHARACTERS:
            raise SchemaError(f"a name with its modules has more than {MAX_NAME_CHARACTERS} characters")
        if meanings.setdefault(full, meaning) != meaning:
            raise SchemaError(f"{full[:40]!r} is defined twice, and not alike")

    def _take_fields(self) -> list[tuple[str, IdlType]]:
        self._take("{")
        fields: list[tuple[str, IdlType]] = []
        while True:
            self._skip_annotations()
            if self._word == "}":
                break
            fields += self._declarators(self._take_type())
        self._take("}")
        self._take(";")
        return fields

    def _declarators(self, declared: IdlType) -> list[tuple[str, IdlType]]:
        """Take names up to the semicolon, each with the length of its array if it has one."""
        found = []
        while True:
            name = self._take_identifier()
            array = declared.array
            if self._word == "[":
                if array:
                    raise SchemaError("an array of arrays is not read")
                self._take("[")
                array = f"[{self._take_length()}]"
                self._take("]")
            found.append((name, IdlType(declared.name, array)))
            separator = self._take()
            if separator != ",":
                break
        if separator != ";":
            raise SchemaError(f"{separator[:40]!r} stands where `;` should")
        return found

    def _take_length(self) -> int:
        """Take a decimal number or the name of a constant, and return the length that it says."""
        text = self._take()
        if not text[0].isdigit():
            name = self._take_name(text)
            text = self.constants.get(_find_in_scope(name, self._modules, self.constants), name)
        if len(text) > MAX_DIGITS_OF_ARRAY_LENGTH or not re.fullmatch(r"0|[1-9][0-9]*", text):
            raise SchemaError(f"{text[:40]!r} is no length of an array")
        return int(text)

    def _take_type(self) -> IdlType:
        word = self._take()
        if word == "sequence":
            self._take("<")
            if self._word == "sequence":
                raise SchemaError("an array of arrays is not read")
            element_type = self._take_type()
            self._words_before(">")
            return IdlType(element_type.name, "[]")
        if word in ("unsigned", "long"):
            while self._word in ("short", "long"):
                word += f" {self._take()}"
        if word in (STRING_TYPE, WSTRING_TYPE) and self._word == "<":
            self._words_before(">")
        if word in ROS_TYPE_BY_IDL_WORDS:
            return IdlType(ROS_TYPE_BY_IDL_WORDS[word], "")
        return IdlType(self._take_name(word), "")

    def _take_name(self, first: str) -> str:
        """Take the rest of a name with or without modules, and return all of it."""
        name = first if first != "::" else first + self._take()
        while self._word == "::" and len(name) <= MAX_NAME_CHARACTERS:
            name += self._take() + self._take()
        if len(name) > MAX_NAME_CHARACTERS or not re.fullmatch(r"(::)?[A-Za-z_]\w*(::[A-Za-z_]\w*)*", name):
            raise SchemaError(f"{name[:40]!r} is no name that is read")
        return name

    def _take_identifier(self) -> str:
        word = self._take()
        if not re.fullmatch(r"[A-Za-z_]\w*", word):
            raise SchemaError(f"{word[:40]!r} is no name")
        return word

    def _skip_annotations(self) -> None:
        """Skip `@name` and `@name(...)`, unless they may change the bytes."""
        while self._word == "@":
            self._take()
            name = self._take()
            if name in BYTE_CHANGING_ANNOTATIONS:
                raise SchemaError(f"@{name} may change the bytes, and is not read")
            if self._word == "(":
                n_open = 0
                while True:
                    word = self._take()
                    n_open += (word == "(") - (word == ")")
                    if not n_open:
                        break

    def _words_before(self, last: str) -> list[str]:
        """Take words up to one, which is taken, too."""
        found = []
        while (word := self._take()) != last:
            found.append(word)
        return found

    def _take(self, expected: str = "") -> str:
        """Take the next word, which must be the expected one if one is."""
        word = self._word
        if not word or (expected and word != expected):
            raise SchemaError(
                f"{word[:40]!r} stands where {expected or 'more'!r} should" if word else "it ends too early"
            )
        if len(word) > MAX_NAME_CHARACTERS and word[0] not in "\"'":
            raise SchemaError(f"a word has more than {MAX_NAME_CHARACTERS} characters")
        self._word = next(self._words, "")
        return word


def _find_in_scope(name: str, scope: Sequence[str], *tables: Collection[str]) -> str:
    """Return the name with the modules, of those around it, that are nearest and define it; else as it is."""
    if name.startswith("::"):
        return name[2:]
    candidates = ("::".join((*scope[:k], name)) for k in range(len(scope), -1, -1))
    return next((each for each in candidates if any(each in table for table in tables)), name)
