"""Register lists: columns found by their headings, register numbering, and doubtful facts that are left out."""

import pytest

from drivecomm.commissioning.importing import imported_model, read_foreign


@pytest.fixture
def read(tmp_path):
    """Return a function that imports a register list from its text."""

    def listed(text, base=None, encoding="utf-8"):
        path = tmp_path / "list.csv"
        path.write_bytes(text.encode(encoding))
        return read_foreign(path, base)

    return listed


@pytest.mark.parametrize(
    "heading",
    [
        "Address,Name,Unit",
        "Register;Description;Units",
        "Reg. Addr.;Parameter Name;Eng. Unit",
        "Modbus-Adresse;Bezeichnung;Einheit",
        "Adresse Modbus;Désignation;Unité",
        "Dirección;Nombre;Unidad",
        "Indirizzo;Descrizione;Unità di misura",
        "Endereço,Descrição,Unidade",
        "Adres;Naam;Eenheid",
        "Adres rejestru;Nazwa;Jednostka",
        "Адрес регистра\tНаименование параметра\tЕд. изм.".replace(" параметра", ""),
        "寄存器地址,名称,单位",
    ],
)
def test_columns_are_found_by_headings_of_many_languages(read, heading):
    delimiter = next(each for each in ";\t," if each in heading)
    found = read(f"{heading}\n{delimiter.join(('16', 'x', 'Hz'))}\n")
    assert set(found.columns) == {"address", "name", "unit"}
    (register,) = found.registers
    assert (register.number, register.title, register.unit) == (16, "x", "Hz")


def test_hexadecimal_column_outranks_a_decimal_column(read):
    found = read("Modbus Reg (dec),Modbus Reg (hex),Description\n4098,1001h,Frequency\n")
    assert found.registers[0].number == 0x1001
    assert found.left[0].what == "Modbus Reg (dec)"


def test_register_column_holds_names_beside_an_address_column(read):
    assert read("Register;Address;Unit\nOutput frequency;8451;Hz\n").registers[0].title == "Output frequency"


@pytest.mark.parametrize(
    ("encoding", "text", "title"),
    [
        ("utf-8-sig", "Adresse;Bezeichnung\n1;Kühler\n", "Kühler"),
        ("utf-16", "Adresse;Bezeichnung\n1;Kühler\n", "Kühler"),
        ("cp1252", "Adresse;Bezeichnung\n1;Kühler\n", "Kühler"),
        ("cp1251", "Адрес;Название\n1;Ток\n", "Ток"),
        ("gb18030", "地址,名称\n1,输出频率\n", "输出频率"),
    ],
)
def test_encoding_is_found_by_the_headings(read, encoding, text, title):
    assert read(text, encoding=encoding).registers[0].title == title


@pytest.mark.parametrize(
    ("addresses", "base", "numbers", "said"),
    [
        (["0", "1"], None, [("", 0), ("", 1)], "counted from 0, as in a telegram"),
        (["5", "6"], None, [("", 5), ("", 6)], "counted from 0, as in a telegram (assumed"),
        (["5", "6"], "1", [("", 4), ("", 5)], "counted from 1"),
        (["40001", "30010"], None, [("", 0), ("i", 9)], "as Modicon did"),
        (["40001", "10003", "00002"], None, [("", 0), ("d", 2), ("c", 1)], "as Modicon did"),
        (["400001", "300010"], None, [("", 0), ("i", 9)], "as Modicon did"),
        (["4x0100", "3x0100"], None, [("", 99), ("i", 99)], "as Modicon did"),
        (["40001-40002", "40003 – 40004"], None, [("", 0), ("", 2)], "as Modicon did"),
        (["40001", "123"], None, [("", 40001), ("", 123)], "counted from 0"),
        (["40001"], "0", [("", 40001)], "counted from 0"),
        (["0x2103", "2104H", "#2105"], None, [("", 0x2103), ("", 0x2104), ("", 0x2105)], "counted from 0"),
        (["2103", "210F"], None, [("", 0x2103), ("", 0x210F)], "in hexadecimal"),
    ],
)
def test_register_numbering_of_the_list_is_recognised(read, addresses, base, numbers, said):
    found = read("Address;Name\n" + "".join(f"{each};r\n" for each in addresses), base)
    assert [(each.kind, each.number) for each in found.registers] == numbers
    assert any(said in sentence for sentence in found.assumptions)


@pytest.mark.parametrize("address", ["8449.3", "8449:3", "0x2101.3", "8449 bit 3"])
def test_bit_after_an_address_is_a_bit_of_the_register(read, address):
    (register,) = read(f"Address;Name\n{address};fault\n").registers
    assert (register.number, register.part, register.type) == (8449, "3", "")


@pytest.mark.parametrize(
    ("column", "cell", "factor"),
    [
        ("Factor", "0,01", "0.01"),
        ("Resolution", "0.1 Hz", "0.1"),
        ("Factor", "1/10", "0.1"),
        ("Multiplier", "÷ 100", "0.01"),
        ("Multiplier", "10", "10"),
        ("Divisor", "1000", "0.001"),
        ("Decimals", "2", "0.01"),
        ("Scale", "0.1", "0.1"),
        ("Unit", "0.01 Hz", "0.01"),
    ],
)
def test_factor_is_read_from_the_column_that_states_it(read, column, cell, factor):
    assert str(read(f"Address;Name;{column}\n1;Frequency;{cell}\n").registers[0].factor) == factor


@pytest.mark.parametrize(
    ("columns", "cells", "reason"),
    [
        ("Scale", "10", "could mean times or divided by"),
        ("Multiplier", "x10", "not an exact factor"),
        ("Divisor", "3", "not an exact factor"),
        ("Factor;Divisor", "0.1;100", "disagree"),
        ("Offset", "-40", "no offset"),
        ("Data type", "16 bit", "width and sign"),
        ("Data type", "INT64", "width and sign"),
        ("Data type;Length", "UINT16;2", "not certain"),
        ("Length", "2", "not certain"),
        ("Data type;Byte order", "UINT32;BADC", "not an order"),
        ("Function", "43", "not a function that reads"),
        ("Bit", "17", "not a bit"),
    ],
)
def test_doubtful_register_is_left_out_with_the_reason(read, columns, cells, reason):
    found = read(f"Address;Name;{columns}\n1;Doubtful;{cells}\n2;Certain{';' * cells.count(';')};\n")
    assert [each.title for each in found.registers] == ["Certain"]
    (left,) = found.left
    assert left.place == "line 2"
    assert reason in left.reason


@pytest.mark.parametrize(
    ("function", "kind"),
    [
        ("03", ""),
        ("FC04", "i"),
        ("3/6/16", ""),
        ("Input register", "i"),
        ("Holding", ""),
        ("1", "c"),
        ("Discrete input", "d"),
    ],
)
def test_function_column_gives_the_kind_of_register(read, function, kind):
    assert read(f"Address;Name;Function\n1;x;{function}\n").registers[0].kind == kind


def test_type_column_with_kinds_of_registers_counts_as_function(read):
    found = read("Address;Name;Type\n1;a;Holding\n2;b;Input\n")
    assert [each.kind for each in found.registers] == ["", "i"]


def test_word_order_is_imported_or_reported_as_assumed(read):
    found = read("Address;Name;Data type;Word order\n1;a;UINT32;CDAB\n3;b;FLOAT;ABCD\n")
    assert [each.word_order for each in found.registers] == ["low", "high"]
    assert not any("high word" in each for each in found.assumptions)
    assert any("high word" in each for each in read("Address;Name;Data type\n1;a;DINT\n").assumptions)


def test_value_texts_are_imported_and_unreadable_ones_listed(read):
    found = read('Address;Name;Values\n1;mode;"0: hand; 1: auto"\n2;state;0=off, 1=on\n3;odd;see page 7\n')
    assert [dict(each.values) for each in found.registers] == [{0: "hand", 1: "auto"}, {0: "off", 1: "on"}, {}]
    assert [each.place for each in found.left] == ["line 4"]


def test_row_without_a_register_is_listed_with_its_line(read):
    found = read("Monitoring\nAddress;Name\n1;a\n\nSetting group 2;\n2;b\nP0.01;c\n")
    assert [(each.place, each.what) for each in found.left] == [("line 5", "Setting group 2"), ("line 7", "P0.01 | c")]


def test_common_name_needs_the_right_unit_and_a_single_candidate(read):
    found = read(
        "Address;Name\n1;Output frequency (Hz)\n2;Output frequency (%)\n3;Output current (A)\n4;Output current (A)\n"
    )
    model = imported_model(found, name="m", file="list.csv")
    assert dict(model.quantities) == {"output_frequency": "1"}
    assert [each.name for each in model.parameters.values()] == [
        "output_frequency",
        "output_frequency_value",
        "output_current_value",
        "output_current_value_4",
    ]


def test_second_value_of_a_register_is_listed(read):
    found = read("Address;Name\n1;Speed\n1;Speed again\n")
    model = imported_model(found, name="m", file="list.csv")
    assert len(model.parameters) == 1
    assert found.left[-1].reason == "another value of the register that is speed already"
