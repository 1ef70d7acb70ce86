"""SPICE kernels: loading order, what is unloaded, and every complaint."""

from pathlib import Path

import pytest

from archives import SPICE, needs_spice
from photoclinometry.io import spice
from photoclinometry.model.errors import InputError

pytest.importorskip("spiceypy")

PCK = "KPL/PCK\n\\begindata\nBODY2101955_RADII = ( {} )\n\\begintext\n"


def kernel(path, value):
    path.write_text(PCK.format(value))
    return path


def test_generic_constants_come_first_and_addenda_last():
    names = ["b.tsc", "dawnfcAddendum002.ti", "pck00009.tpc", "a.tf", "itokawa_gaskell_n3.tpc"]
    ordered = [p.name for p in spice.loading_order([Path(n) for n in names])]
    assert ordered == ["pck00009.tpc", "a.tf", "b.tsc", "itokawa_gaskell_n3.tpc", "dawnfcAddendum002.ti"]


def test_the_last_kernel_wins(tmp_path):
    first, second = kernel(tmp_path / "a.tpc", "1 2 3"), kernel(tmp_path / "b.tpc", "4 5 6")
    with spice.loaded_kernels([first, second]) as kernels:
        assert kernels.keyword("BODY2101955_RADII") == (4.0, 5.0, 6.0)
        assert kernels.keyword("BODY2101955_POLE_RA") is None
        # Another set beside it knows nothing of the first.
        with spice.loaded_kernels([second, first]) as others:
            assert others.keyword("BODY2101955_RADII") == (1.0, 2.0, 3.0)
        assert kernels.keyword("BODY2101955_RADII") == (4.0, 5.0, 6.0)


def test_all_keywords_of_an_instrument_are_read(tmp_path):
    text = "INS-1_A = ( 1 2 )\nINS-1_B = 'X'\nINS-12_A = 3\n"
    (tmp_path / "a.ti").write_text(f"KPL/IK\n\\begindata\n{text}\\begintext\n")
    with spice.loaded_kernels([tmp_path / "a.ti"]) as kernels:
        assert kernels.keywords_of(-1) == {"INS-1_A": (1.0, 2.0), "INS-1_B": ("X",)}
        assert kernels.keywords_of(-2) == {}


def test_what_is_unloaded_is_forgotten(tmp_path):
    with spice.loaded_kernels([kernel(tmp_path / "a.tpc", "1 2 3")]) as kernels:
        kernels.unload()
        assert kernels.keyword("BODY2101955_RADII") is None
        kernels.load(kernel(tmp_path / "b.tpc", "4 5 6"))
        assert kernels.keyword("BODY2101955_RADII") == (4.0, 5.0, 6.0)


def test_the_process_ends_with_the_block(tmp_path):
    kernel(tmp_path / "a.tpc", "1 2 3")
    with pytest.raises(RuntimeError, match="on the way"), spice.loaded_kernels([tmp_path]) as kernels:
        raise RuntimeError("on the way")
    assert kernels._child.process.poll() is not None


def test_a_breakdown_of_spice_is_an_error_that_names_the_binary_kernels(tmp_path):
    kernel(tmp_path / "a.tpc", "1 2 3")
    with spice.loaded_kernels([tmp_path]) as kernels:
        kernels.files.append(tmp_path / "b.bsp")
        kernels._child.process.kill()
        with pytest.raises(
            InputError, match=r"SPICE broke down when asked for the keyword X: one of b\.bsp is damaged"
        ):
            kernels.keyword("X")


def test_a_folder_s_meta_kernel_is_taken_alone(tmp_path):
    kernel(tmp_path / "a.tpc", "1 2 3")
    kernel(tmp_path / "z.tpc", "4 5 6")
    meta = tmp_path / "m.tm"
    meta.write_text(f"KPL/MK\n\\begindata\nKERNELS_TO_LOAD = ( '{tmp_path / 'a.tpc'}' )\n\\begintext\n")
    with spice.loaded_kernels([tmp_path]) as kernels:
        assert kernels.files == [meta]
        assert kernels.keyword("BODY2101955_RADII") == (1.0, 2.0, 3.0)
    (tmp_path / "n.mk").write_text(meta.read_text())
    with pytest.raises(InputError, match="holds 2 meta-kernels; name the one"):
        spice.kernel_files([tmp_path])


@pytest.mark.parametrize(
    ("name", "content", "message"),
    [
        ("a.tpc", b"hello\n", "is not a SPICE kernel"),
        ("a.bsp", b"\0" * 2000, "is not a SPICE kernel"),
        ("a.bsp", b"DAF/SPK " + b"\0" * 2000, "SPICE cannot load"),
        ("a.tpc", b"KPL/PCK\n\\begindata\nA = B = C\n", "SPICE cannot load"),
    ],
)
def test_what_is_no_kernel_is_named(tmp_path, name, content, message):
    (tmp_path / name).write_bytes(content)
    with (
        pytest.raises(InputError, match=rf"{name}: .*{message}|{message}"),
        spice.loaded_kernels([tmp_path / name]),
    ):
        pass


def test_a_meta_kernel_that_loads_itself_is_refused(tmp_path):
    meta = tmp_path / "m.tm"
    meta.write_text(f"KPL/MK\n\\begindata\nKERNELS_TO_LOAD = ( '{meta}' )\n\\begintext\n")
    with pytest.raises(InputError, match=r"m\.tm: SPICE cannot load"), spice.loaded_kernels([meta]):
        pass


def meta_kernel(path, files, value="./data"):
    names = "".join(f"'$K/{name}'\n" for name in files)
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_text(
        f"KPL/MK\n\\begindata\nPATH_VALUES = ( '{value}' )\nPATH_SYMBOLS = ( 'K' )\nKERNELS_TO_LOAD = ( {names} )\n"
        "\\begintext\n"
    )
    return path


def test_relative_paths_of_a_meta_kernel_are_taken_from_its_own_folder(tmp_path, monkeypatch):
    """As NAIF's archives have them: mk/x.tm names ../pck/a.tpc by PATH_VALUES = ( '..' )."""
    (tmp_path / "archive" / "pck").mkdir(parents=True)
    kernel(tmp_path / "archive" / "pck" / "a.tpc", "1 2 3")
    kernel(tmp_path / "archive" / "pck" / "b.tpc", "4 5 6")
    meta = meta_kernel(tmp_path / "archive" / "mk" / "x.tm", ["pck/a.tpc", "pck/b.tpc"], "..")
    monkeypatch.chdir(tmp_path)
    with spice.loaded_kernels([meta]) as kernels:
        assert kernels.keyword("BODY2101955_RADII") == (4.0, 5.0, 6.0)
        assert kernels.keyword("PATH_VALUES") is None
    monkeypatch.chdir(tmp_path / "archive" / "mk")  # from there the paths lead to the same files
    with spice.loaded_kernels([meta]) as kernels:
        assert kernels.keyword("BODY2101955_RADII") == (4.0, 5.0, 6.0)


def test_kernels_that_a_meta_kernel_names_in_vain_are_named(tmp_path):
    (tmp_path / "data").mkdir()
    kernel(tmp_path / "data" / "a.tpc", "1 2 3")
    meta = meta_kernel(tmp_path / "x.tm", ["a.tpc", "lsk/b.tls", "c.bsp"])
    with (
        pytest.raises(
            InputError,
            match=r"x\.tm: 2 of the 3 kernels that it names are neither .*: \./data/lsk/b\.tls, \./data/c\.bsp; "
            "fetch them, or correct PATH_VALUES",
        ),
        spice.loaded_kernels([meta]),
    ):
        pass


@pytest.mark.data
@needs_spice
def test_a_time_that_kernels_do_not_cover_is_told_with_their_times():
    folder = SPICE / "osiris_rex_mapcam_bennu"
    with spice.loaded_kernels([folder]) as kernels:
        time = kernels.time_of_utc("2021-06-01T00:00:00")
        said = (
            r"V001_0\.bsp \(2019-03-03T\S+ to 2019-03-03T\S+\).* does not give the position of SUN seen from 2101955 "
        )
        begins = r"^the time 2021-06-01T00:00:00 is outside of what the kernels cover: load kernels of that time\. .*"
        with pytest.raises(InputError, match=begins + said) as raised:
            kernels.position("SUN", time, "J2000", "LT+S", "2101955")
        assert len(str(raised.value)) < 500
        with pytest.raises(InputError, match=begins + r"\.bc \(2019.* give the rotation from IAU_BENNU"):
            kernels.rotation("IAU_BENNU", "ORX_OCAMS_MAPCAM", time)
        with pytest.raises(InputError, match=r"does not give the position of JUPITER") as raised:
            kernels.position("JUPITER", kernels.time_of_utc("2019-03-03T10:51:00"), "J2000", "LT+S", "2101955")
        assert "outside of" not in str(raised.value)


def test_missing_kernels_and_empty_folders_are_named(tmp_path):
    with pytest.raises(InputError, match="no such kernel"), spice.loaded_kernels([tmp_path / "a.bsp"]):
        pass
    with pytest.raises(InputError, match="holds no SPICE kernels"):
        spice.kernel_files([tmp_path])


def test_what_kernels_do_not_tell_is_said(tmp_path):
    kernel(tmp_path / "a.tpc", "1 2 3")
    with spice.loaded_kernels([tmp_path]) as kernels:
        with pytest.raises(InputError, match=r"does not give the time of '2020-01-01'.*NOLEAPSECONDS"):
            kernels.time_of_utc("2020-01-01")
        with pytest.raises(InputError, match="does not give the position of SUN"):
            kernels.position("SUN", 0.0, "J2000", "NONE", "EARTH")
        with pytest.raises(InputError, match=r"knows no body 'nibiru'.*--body"):
            kernels.body_code("nibiru")
        with pytest.raises(InputError, match="no frame fixed to body 2999999"):
            kernels.body_frame(2999999)
        assert kernels.frame_name(-999999) is None


@pytest.mark.data
@needs_spice
def test_a_real_folder_is_loaded_in_the_order_that_its_readme_asks_for():
    names = [p.name for p in spice.kernel_files([SPICE / "hayabusa_amica_itokawa"])]
    assert names.index("pck00009.tpc") < names.index("itokawa_gaskell_n3.tpc")
    assert names[-1] == "amicaAddendum002.ti"
    names = [p.name for p in spice.kernel_files([SPICE / "dawn_fc_ceres"])]
    assert names.index("dawn_ceres_SPG20160107.tpc") < names.index("dawn_ceres_v05.tpc")


@pytest.mark.data
@needs_spice
def test_a_damaged_kernel_that_crashes_spice_is_refused(tmp_path):
    """16 bytes more in the middle of a segment: CSPICE reads counts from the wrong place, and crashes."""
    folder = SPICE / "osiris_rex_mapcam_bennu"
    good = folder / "20190303T100344S990_map_iofL2pan_V001_0.bsp"
    data = good.read_bytes()
    (tmp_path / good.name).write_bytes(data[:5297] + data[5281:])
    files = [tmp_path / f.name if f == good else f for f in spice.kernel_files([folder])]
    with (
        spice.loaded_kernels(files) as kernels,
        pytest.raises(
            InputError,
            match=r"SPICE broke down when asked for the position of SUN.*20190303T100344S990_map_iofL2pan_V001_0.bsp",
        ),
    ):
        kernels.position("SUN", 604882849.433, "IAU_BENNU", "LT+S", "2101955")
