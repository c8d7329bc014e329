//! Valid tables, and the error messages of invalid ones.

mod truths;

use crate::frame::{
    Frame, Part, ReadOptions, read_conductivities, read_frames, read_frames_with, read_frames_without, read_table,
    write_array, write_frames, write_whole,
};
use crate::protocol::Protocol;
use std::path::PathBuf;

/// A folder with one file in it.
fn file(name: &str, content: impl AsRef<[u8]>) -> (tempfile::TempDir, PathBuf) {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join(name);
    std::fs::write(&path, content).unwrap();
    (folder, path)
}

/// Four electrodes, twelve values.
fn protocol() -> Protocol {
    Protocol::adjacent(4).unwrap()
}

fn row(last: &str) -> String {
    format!("2,1,3,4,5,6,7,8,9,10,11,{last}")
}

/// The error of a file of frames.
fn frame_error(content: impl AsRef<[u8]>) -> String {
    let (_folder, path) = file("f.csv", content);
    let message = read_frames(&path, &protocol()).unwrap_err().to_string();
    message.split_once("f.csv").unwrap().1.to_string()
}

#[test]
fn headers_byte_order_marks_and_carriage_returns_do_no_harm() {
    let names: Vec<String> = (0..12).map(|channel| format!("v{channel}")).collect();
    for text in [
        format!("{}\n{}\n", row("12"), row("1e-3")),
        format!("{}\n{}\n{}", names.join(","), row("12"), row("1e-3")),
        format!("\u{feff}{}\r\n{}\r\n\r\n", row(" 12 "), row("0.001")),
    ] {
        let (_folder, path) = file("f.csv", text);
        let frames = read_frames(&path, &protocol()).unwrap();
        assert_eq!((frames.len(), frames[0][11], frames[1][11]), (2, 12.0, 0.001));
    }
}

/// The frames of a file, or its error.
fn frames(content: &str) -> Result<Vec<Vec<f64>>, String> {
    let (_folder, path) = file("f.csv", content);
    let read = read_frames(&path, &protocol()).map_err(|error| error.to_string());
    read.map(|frames| frames.into_iter().map(|frame| frame.0).collect())
        .map_err(|message| message.split_once("f.csv").unwrap().1.to_string())
}

/// The text that pandas writes for a frame of 12 channels, by `to_csv` with and without an index or a header.
#[test]
fn headers_that_count_and_row_numbers_are_no_values() {
    let header = |first: usize| (first..first + 12).map(|n| n.to_string()).collect::<Vec<_>>().join(",");
    let (a, b) = (row("12"), row("13"));
    for text in [
        format!("{}\n{a}\n{b}\n", header(0)),
        format!("{}\n{a}\n{b}\n", header(1)),
        format!(",{}\n0,{a}\n1,{b}\n", header(0)),
        format!("index,{}\n0,{a}\n1,{b}\n", header(0)),
        format!("frame,a,b,c,d,e,f,g,h,i,j,k,l\n1,{a}\n2,{b}\n"),
        format!("\"\",\"a\",b,c,d,e,f,g,h,i,j,k,l\n7,{a}\n9,{b}\n"),
        format!("0,{a}\n1,{b}\n"),
        format!(",{}\n0,{a}\n1,{b}\n", header(0)).replace(',', ";"),
        format!("{}\n{}\n", a.replace(',', ";"), b.replace(',', ";").replace("13", "13,0")),
        // As boards write them: comments, empty lines, white space, a separator at the end, times.
        format!("# a board\n\n{a}\n\n# again\n{b}\n"),
        format!("{}\n{}\n", a.replace(',', "  "), b.replace(',', " ")),
        format!("{}\n{}\n", a.replace(',', "\t"), b.replace(',', "\t")),
        format!("{a},\n{b},\n"),
        format!("0,{a},\n1,{b},\n"),
        format!("time_ms,a,b,c,d,e,f,g,h,i,j,k,l\n10,{a}\n12.5,{b}\n"),
    ] {
        let read = frames(&text).unwrap();
        let last: Vec<(usize, f64, f64)> = read.iter().map(|row| (row.len(), row[0], row[11])).collect();
        assert_eq!(last, [(12, 2.0, 12.0), (12, 2.0, 13.0)], "{text}");
    }
    // Numbers in the order of text: the columns are those of the channels that they name.
    let protocol = Protocol::adjacent(8).unwrap();
    let mut sorted: Vec<String> = (0..protocol.channel_count()).map(|number| number.to_string()).collect();
    sorted.sort();
    let values: Vec<String> = sorted.iter().map(|number| format!("{number}.5")).collect();
    let (_folder, path) = file("sorted.csv", format!("{}\n{}\n", sorted.join(","), values.join(",")));
    let read = read_frames(&path, &protocol).unwrap();
    assert_eq!(read.iter().map(|row| [row[2], row[10]]).collect::<Vec<_>>(), [[2.5, 10.5]]);
    let (_folder, path) = file("c.csv", "0,1,2\n0.5,1,2\n");
    assert_eq!(read_conductivities(&path, 3).unwrap(), vec![vec![0.5, 1.0, 2.0]]);
    let decimal_commas = row("1").replace(',', ";").replace("10", "10,25");
    assert_eq!(frames(&decimal_commas).unwrap()[0][9], 10.25);
}

#[test]
fn columns_that_are_no_channels_are_refused_with_the_fix() {
    let (a, b) = (row("12"), row("13"));
    let message = frames(&format!("bridge,a,b,c,d,e,f,g,h,i,j,k,l\n0.0,{a}\n0.01,{b}\n")).unwrap_err();
    assert_eq!(
        message,
        ", row 2, column 1: frames of this protocol have 12 values, and the row has one more: if the first column `bridge` has \
         times, call it time_s in a header; if not, remove what is no channel"
    );
    // Two rows rise by chance; and it may be the last column that has times.
    let message = frames(&format!("0.11,{a}\n0.12,{b}\n")).unwrap_err();
    assert!(message.contains("call it time_s in a header"), "{message}");
    let steady: String = (0..6).map(|k| format!("{k}.5,{},{k}.25\n", a.rsplit_once(',').unwrap().0)).collect();
    assert!(frames(&steady).unwrap_err().contains("call it time_s in a header"));
    // Neither row numbers nor times: one value too many.
    let message = frames(&format!("5,{a}\n5,{b}\n")).unwrap_err();
    assert!(
        message.starts_with(", row 1: too many values: 13, but frames of this protocol have 12; name"),
        "{message}"
    );
    let message = frames(&a.replacen(',', " ", 1)).unwrap_err();
    assert_eq!(message, ", row 1: some values are separated by spaces or tabs; separate all of them by commas");
    let message = frames(&a.replace(",3,", ",(3-1.5e-3j),")).unwrap_err();
    assert!(message.starts_with(": it has 1 complex value: choose their part with --part"), "{message}");
    let message = frames(&format!("{a}.5,{b}\n")).unwrap_err();
    assert!(message.contains("24, but frames of this protocol have 12; if magnitudes and phases"), "{message}");
    let message = frames(&format!("{a},{b}\n")).unwrap_err();
    assert!(message.contains("; all are whole numbers: numbers with decimal commas need semicolons"), "{message}");
    let (_folder, path) = file("f.csv", format!("{a},0192,{b}\n").replacen("2,", "", 1));
    let options = ReadOptions { part: Some(Part::Real), ..ReadOptions::default() };
    let message = read_frames_with(&path, &protocol(), &options).unwrap_err().to_string();
    assert!(message.contains("the decimal commas stand between commas"), "{message}");
}

/// Where a column that is named as times or row numbers stands: it is no channel, and must not take the place of one.
#[test]
fn columns_with_the_names_of_times_are_never_channels() {
    let names = "a,b,c,d,e,f,g,h,i,j,k";
    let (a, b) = (row("12"), row("13"));
    for text in [
        format!("frame,time_s,{names},l\n7,0.5,{a}\n9,0.25,{b}\n"),
        format!("{names},l,time_s\n{a},0.5\n{b},0.25\n"),
        format!("frame,{names},l,Time (s)\n7,{a},0.5\n9,{b},0.25\n"),
    ] {
        let read = frames(&text).unwrap();
        assert_eq!((read[0][0], read[0][11], read[1][11]), (2.0, 12.0, 13.0), "{text}");
    }
    for name in ["time_s", "t", "timestamp", "frame", "index"] {
        let message = frames(&format!("{name},{names}\n{a}\n{b}\n")).unwrap_err();
        let expected =
            format!(": the first column is `{name}`, so the rows have 11 values, not 12: add what is missing");
        assert!(message.starts_with(&expected), "{message}");
    }
    let message = frames(&format!("{names},time_s\n{a}\n")).unwrap_err();
    assert!(message.starts_with(": the last column is `time_s`, so the rows have 11 values"), "{message}");
    let (_folder, path) = file("c.csv", "time_s,a,b\n0.5,1,2\n");
    assert!(read_conductivities(&path, 3).unwrap_err().to_string().contains("so the rows have 2 values, not 3"));
    // Without names, a word how to give some.
    for text in [format!("7,0.5,{a}\n9,0.25,{b}\n"), format!("{a},0.5\n{b},0.25\n")] {
        assert!(frames(&text).unwrap_err().contains("name columns of row numbers `frame`"), "{text}");
    }
}

/// What cannot be read is no header: without its row, all later frames would have the number of the one before.
#[test]
fn a_first_row_without_values_is_no_header() {
    let a = row("12");
    for (value, fix) in [
        ("OVLD", "`OVLD` is not a number: write it as -1.5e+02, or NaN where there is no value"),
        ("1.5D+02", "`1.5D+02` is not a number: write"),
        ("\u{2212}1.5", "`\u{2212}1.5` is not a number: write"),
        ("1.5 mV", "`1.5 mV` is not a number"),
        ("---", "`---` is not a number"),
    ] {
        let message = frames(&format!("{}\n{a}\n", [value; 12].join(","))).unwrap_err();
        assert!(message.starts_with(&format!(", row 1, column 1: {fix}")), "{message}");
    }
    let pipes = frames(&format!("{0}\n{0}\n", a.replace(',', "|"))).unwrap();
    assert_eq!((pipes.len(), pipes[1][11]), (2, 12.0));
}

#[test]
fn steady_times_without_a_name_are_no_channel() {
    let rows = |end: &str| (0..5).map(|k| format!("17{k}.01{k},{}{end}\n", row("12"))).collect::<String>();
    for text in [rows(""), rows(","), format!("# seconds since noon,a,b,c,d,e,f,g,h,i,j,k,l\n{}", rows(""))] {
        let read = frames(&text).unwrap();
        assert!(read.len() == 5 && read.iter().all(|row| row[0] == 2.0 && row[11] == 12.0), "{text}");
    }
}

#[test]
fn a_bad_value_is_named_by_row_and_column() {
    let two = |last: &str| format!("{}\n{}\n", row("12"), row(last));
    let channel = |value: &str| format!(", row 2: channel 11 is {value}: mend the frame, or leave the channel out");
    assert_eq!(frame_error(two("NaN")), channel("NaN"));
    assert_eq!(frame_error(two("-inf")), channel("-inf"));
    assert_eq!(frame_error(two("1e999")), channel("inf"));
    assert_eq!(frame_error(two("")), channel("NaN"));
    assert_eq!(frame_error(two("open")), ", row 2, column 12: `open` is not a number");
    assert_eq!(frame_error(two("1,13")), ", row 2: too many values: 13, but the rows before have 12");
    assert_eq!(frame_error("1,2,3\n"), ", row 1: too few values: 3, but frames of this protocol have 12");
}

#[test]
fn channels_that_are_left_out_may_have_no_value() {
    let row = "2,NaN,3,4,5,6,7,8,9,10,inf,";
    // Row numbers before the channels do not shift them.
    for text in [format!("{row}\n{row}\n"), format!("0,{row}\n1,{row}\n")] {
        let (_folder, path) = file("f.csv", text);
        let frames = read_frames_without(&path, &protocol(), &[1, 10, 11, 99]).unwrap();
        assert_eq!(frames, vec![Frame(vec![2.0, 0.0, 3.0, 4.0, 5.0, 6.0, 7.0, 8.0, 9.0, 10.0, 0.0, 0.0]); 2]);
        let message = read_frames_without(&path, &protocol(), &[1, 11]).unwrap_err().to_string();
        assert!(message.ends_with("row 1: channel 10 is inf: mend the frame, or leave the channel out"), "{message}");
    }
    let (_folder, path) = file("c.csv", "0.5,,2\n");
    assert!(read_conductivities(&path, 3).unwrap_err().to_string().contains("the conductivity of cell 1 is NaN"));
}

#[test]
fn a_file_that_is_wrong_as_a_whole_is_named() {
    for empty in ["", "\u{feff}", "\r\n", "a,b,c\n"] {
        assert_eq!(frame_error(empty), ": the file is empty: it holds no row of numbers");
    }
    assert!(frame_error([0x31, 0x32, 0x33, 0xff, 0]).contains("not text (byte 3)"));
    let wide: Vec<u8> = row("12").encode_utf16().flat_map(u16::to_le_bytes).collect();
    assert!(frame_error(wide).contains("UTF-16 text without a byte-order mark"));
    assert!(frame_error("\n<!DOCTYPE html>\n<p>404</p>\n").contains("a page of HTML"));
    assert!(frame_error(b"PK\x03\x04rubbish").contains("not an NPZ file"));
    assert!(frame_error(b"\x93NUMPY\x01").contains("cut short"));
    let missing = read_table(&PathBuf::from("no/such.csv"), "frames").unwrap_err().to_string();
    assert!(missing.starts_with("no/such.csv: "), "{missing}");
}

#[test]
fn a_conductivity_that_no_matter_has_is_named_by_its_cell() {
    let error = |text: &str| {
        let (_folder, path) = file("c.csv", text);
        read_conductivities(&path, 3).unwrap_err().to_string()
    };
    for value in ["0", "-1", "nan", "inf"] {
        let message = error(&format!("1,1,1\n1,{value},1\n"));
        assert!(message.contains("row 2, column 2: the conductivity of cell 1 is"), "{message}");
    }
    assert!(error("1,1\n").contains("too few values: 2, but maps of this mesh have 3"));
    assert!(error("1\n1\n1\n").contains("write them in one row"));
}

#[test]
fn numbers_come_back_bit_for_bit_in_every_format() {
    let frames = vec![Frame(vec![1.0 / 3.0, -2.5e-300, 0.1 + 0.2]), Frame(vec![f64::MAX, -0.0, 1e22])];
    let folder = tempfile::tempdir().unwrap();
    for name in ["f.csv", "f.npy", "f.npz"] {
        let path = folder.path().join(name);
        write_frames(&path, &frames).unwrap();
        let table = read_table(&path, "frames").unwrap();
        let bits = |values: &[f64]| values.iter().map(|value| value.to_bits()).collect::<Vec<_>>();
        for (frame, row) in frames.iter().zip(&table.rows) {
            assert_eq!(bits(frame), bits(row), "{name}");
        }
    }
}

/// An NPY file as written by `numpy.save`, from its header entries and its data.
fn npy(descr: &str, fortran: &str, shape: &str, data: &[u8]) -> Vec<u8> {
    let header = format!("{{'descr': '{descr}', 'fortran_order': {fortran}, 'shape': {shape}, }}\n");
    let mut bytes = b"\x93NUMPY\x01\x00".to_vec();
    bytes.extend((header.len() as u16).to_le_bytes());
    bytes.extend(header.as_bytes());
    bytes.extend(data);
    bytes
}

#[test]
fn npy_files_of_other_types_and_orders_are_read() {
    let rows = |bytes: Vec<u8>| {
        let (_folder, path) = file("a.npy", bytes);
        read_table(&path, "frames").map(|table| table.rows).map_err(|error| error.to_string())
    };
    let f32s: Vec<u8> = [1.0_f32, 2.0, 3.0, 4.0, 5.0, 6.0].iter().flat_map(|v| v.to_le_bytes()).collect();
    let expected = vec![vec![1.0, 2.0, 3.0], vec![4.0, 5.0, 6.0]];
    assert_eq!(rows(npy("<f4", "False", "(2, 3)", &f32s)).unwrap(), expected);
    let columns: Vec<u8> = [1_i32, 4, 2, 5, 3, 6].iter().flat_map(|v| v.to_be_bytes()).collect();
    assert_eq!(rows(npy(">i4", "True", "(2, 3)", &columns)).unwrap(), expected);
    assert_eq!(rows(npy("|u1", "False", "(3,)", &[1, 2, 3])).unwrap(), vec![vec![1.0, 2.0, 3.0]]);
    assert!(rows(npy("<c16", "False", "(1, 1)", &[0; 16])).unwrap_err().contains("1 complex value"));
    assert!(rows(npy("<M8", "False", "(1, 1)", &[0; 8])).unwrap_err().contains("`<M8` is no number"));
    assert!(rows(npy("<f4", "False", "(9, 9)", &f32s)).unwrap_err().contains("but there are 6 values"));
    let huge = format!("({0}, {0})", usize::MAX);
    assert!(rows(npy("<f4", "False", &huge, &f32s)).unwrap_err().contains("but there are 6 values"));
    assert!(rows(npy("<f4", "False", "(2, 3)", &f32s[1..])).unwrap_err().contains("cut short"));
}

#[test]
fn parts_of_complex_arrays_and_columns_are_read() {
    let read = |name: &str, content: Vec<u8>, part| {
        let (_folder, path) = file(name, content);
        let options = ReadOptions { part: Some(part), ..ReadOptions::default() };
        read_frames_with(&path, &protocol(), &options).map(|frames| frames[0].0.clone()).map_err(|e| e.to_string())
    };
    let real: Vec<f64> = (0..12).map(|channel| 3.0 * f64::from(channel) + 3.0).collect();
    let [imaginary, magnitude] = [-4.0, 5.0].map(|factor| real.iter().map(|v| factor * v / 3.0).collect::<Vec<_>>());
    let pairs = || real.iter().zip(&imaginary).flat_map(|(a, b)| [*a, *b]);
    let doubles: Vec<u8> = pairs().flat_map(f64::to_le_bytes).collect();
    let singles: Vec<u8> = pairs().flat_map(|value| (value as f32).to_be_bytes()).collect();
    let cells: Vec<String> = real.iter().zip(&imaginary).map(|(a, b)| format!("{a}{b}i")).collect();
    let columns: Vec<String> = pairs().map(|value| value.to_string()).collect();
    for (part, expected) in [(Part::Real, &real), (Part::Imaginary, &imaginary), (Part::Magnitude, &magnitude)] {
        let same = |name, content| assert_eq!(read(name, content, part).as_ref(), Ok(expected), "{part:?} {name}");
        same("f.npy", npy("<c16", "False", "(1, 12)", &doubles));
        same("f.npy", npy(">c8", "False", "(12,)", &singles));
        same("f.csv", cells.join(",").into());
        // Row numbers have no parts.
        same("f.csv", format!("0,{0}\n1,{0}\n", cells.join(",")).into());
        same("f.csv", cells.join(" ").into());
        let halves = read("f.csv", columns.join(",").into(), part);
        let first = if part == Part::Imaginary { &imaginary } else { &real };
        assert_eq!(halves.as_ref(), Ok(first), "pairs: the first, or the second for imaginary parts");
    }
    let timed =
        format!("time_s,{0}\n0.5,{0}\n", columns.join(",")).replacen(&columns.join(","), &vec!["a"; 24].join(","), 1);
    assert_eq!(read("f.csv", timed.into(), Part::Real), Ok(real.clone()));
    let negative = columns.join(",").replacen("9,", "-9,", 1);
    assert!(read("f.csv", negative.into(), Part::Magnitude).unwrap_err().contains("is negative and no magnitude"));
    assert!(read("f.csv", row("12").into(), Part::Real).unwrap_err().contains("leave --part out"));
}

/// As boards and programs write the same two frames.
#[test]
fn what_stands_beside_the_values_is_not_read() {
    let values = |first: f64| (0..12).map(|channel| first + f64::from(channel)).collect::<Vec<f64>>();
    let expected = [values(1.5), values(-2.5)];
    let words = |separator: &str| {
        expected.clone().map(|row| row.iter().map(f64::to_string).collect::<Vec<_>>().join(separator))
    };
    let read = |content: Vec<u8>| {
        let (_folder, path) = file("f.csv", content);
        read_frames(&path, &protocol()).map(|frames| frames.into_iter().map(|frame| frame.0).collect::<Vec<_>>())
    };
    let [a, b] = words(",");
    let names = ["v"; 12].join(",");
    let tabs = words("\t").map(|row| row.replace('.', ","));
    let quoted = words("\",\"").map(|row| format!("\"{}\"", row.replace('.', ",")));
    let named = expected.clone().map(|row| {
        let fields = row.iter().enumerate().map(|(channel, value)| format!("ch{channel}:{value}"));
        fields.collect::<Vec<_>>().join(",")
    });
    let drives = |first: usize| -> String {
        let rows = expected.iter().flat_map(|frame| frame.chunks(3).enumerate());
        rows.map(|(drive, row)| format!("{},{},{},{}\n", drive + first, row[0], row[1], row[2])).collect()
    };
    for content in [
        format!("12:00:01.123 -> {a}\n12:00:01.223 -> {b}\n"),
        format!("time,{names}\n2024-05-01T12:00:00.1Z,{a}\n2024-05-01T12:00:00.2Z,{b}\n"),
        format!("date time,{names}\n05/01/2024 12:00:00:123,{a}\n05/01/2024 12:00:00:223,{b}\n"),
        format!("date,time,{names}\n1.5.2024,12:00:00,{a}\n1.5.2024,12:00:01,{b}\n"),
        format!("magnitudes: {a}\nmagnitudes: {b}\n"),
        format!("[{a}]\n[{b}]\n"),
        tabs.join("\n"),
        quoted.join("\n"),
        named.join("\r"),
        format!("{}\n{a}\n{b}\n", (0..12).map(|m| format!("V{m}:{}", m + 1)).collect::<Vec<_>>().join(",")),
        format!(
            "12:00:00.9 -> {}\n12:00:01 -> {}\n12:00:02 -> {}\n",
            names.replace(',', " "),
            words(" ")[0],
            words(" ")[1]
        ),
        format!("\t{}\n0\t{}\n1\t{}\n", names.replace(',', "\t"), words("\t")[0], words("\t")[1]),
        drives(0),
        drives(1),
    ] {
        assert_eq!(read(content.clone().into()).unwrap(), expected, "{content}");
    }
    let wide: Vec<u8> = format!("\u{feff}{a}\r\n{b}\r\n").encode_utf16().flat_map(u16::to_le_bytes).collect();
    assert_eq!(read(wide).unwrap(), expected);
    let lost = drives(1).replacen("3,", "2,", 1);
    assert!(read(lost.into()).unwrap_err().to_string().contains("is of the drive 2, where 3 follows"));
}

/// Rows of one drive each, with an empty line after each frame: what is between these must be a frame.
#[test]
fn a_lost_row_of_a_drive_does_not_shift_the_frames_after_it() {
    let rows: Vec<String> = (0..16).map(|row| format!("{row}.5,{row}.25,{row}.125\n")).collect();
    let frames = |rows: &[String]| rows.chunks(4).map(|frame| frame.concat() + "\n").collect::<String>();
    let (_folder, path) = file("f.csv", frames(&rows));
    assert_eq!(read_frames(&path, &protocol()).unwrap().len(), 4);
    // A row of the second frame is lost, and one of the third comes twice.
    let wrong =
        frames(&rows).replace("5.5,5.25,5.125\n", "").replace("9.5,9.25,9.125\n", &"9.5,9.25,9.125\n".repeat(2));
    let error = frame_error(wrong);
    assert!(error.contains("4 rows of one drive each, but the rows 6 to 8") && error.contains("are 3"), "{error}");
}

#[test]
fn overloads_are_no_values() {
    let frame = row("12").replacen("4", "9.9E+37", 1).replacen("5", "-9.91e37", 1);
    let (_folder, path) = file("f.csv", frame.into_bytes());
    assert!(read_frames(&path, &protocol()).unwrap_err().to_string().contains("is NaN"));
    let options = ReadOptions { keep_incomplete: true, ..ReadOptions::default() };
    let frames = read_frames_with(&path, &protocol(), &options).unwrap();
    assert_eq!(frames[0].iter().filter(|value| value.is_nan()).count(), 2);
}

#[test]
fn columns_with_the_names_of_channels_may_have_any_order() {
    let read = |header: &str, row: &str| frames(&format!("{header}\n{row}\n")).map(|rows| rows[0].clone());
    let channels = protocol();
    let mut names: Vec<(String, usize)> = channels
        .channels()
        .iter()
        .enumerate()
        .map(|(number, channel)| {
            let ([a, b], [m, n]) = (channel.drive, channel.measure);
            (format!("v_{a}_{b}_{m}_{n}"), number)
        })
        .collect();
    names.reverse();
    let header = |names: &[(String, usize)]| names.iter().map(|(name, _)| name.as_str()).collect::<Vec<_>>().join(",");
    let values = names.iter().map(|(_, number)| format!("{number}.5")).collect::<Vec<_>>().join(",");
    let expected: Vec<f64> = (0..12).map(|number| f64::from(number) + 0.5).collect();
    assert_eq!(read(&header(&names), &values), Ok(expected.clone()));
    assert_eq!(read(&format!("bath,{}", header(&names)), &format!("21.5,{values}")), Ok(expected.clone()));
    for first in [0, 1] {
        let numbered: Vec<(String, usize)> = (0..12).rev().map(|k| (format!("ch{}", k + first), k)).collect();
        assert_eq!(read(&header(&numbered), &values), Ok(expected.clone()), "from {first}");
    }
    // As comments, with a comma at the end, before each value, and with row names as R writes them.
    let both = |text: String| frames(&text).map(|rows| (rows[0].clone(), rows[1].clone()));
    let twice = Ok((expected.clone(), expected.clone()));
    let quoted = header(&names).replace(',', "\" \"");
    let spaces = values.replace(',', " ");
    let cells = header(&names).split(',').zip(values.split(',')).map(|(a, b)| format!("{a}:{b}")).collect::<Vec<_>>();
    for text in [
        format!("# {}\n{values}\n{values}\n", header(&names)),
        format!("# a board\n# {}\n{spaces}\n{spaces}\n", header(&names)),
        format!("{},\n{values}\n{values}\n", header(&names)),
        format!("frame,{},\n1,{values}\n2,{values}\n", header(&names)),
        format!("\"{quoted}\"\n\"5\" {spaces}\n\"9\" {spaces}\n"),
        format!("{0}\n{0}\n", cells.join(",")),
        format!("{0}\n{0}\n", cells.join(", ").replace(':', ": ")),
        format!("frame,time_s,{},temperature\n1,0.5,{values},21.5\n2,1,{values},21.5\n", header(&names)),
    ] {
        assert_eq!(both(text.clone()), twice, "{text}");
    }
    let other = [&cells[1..], &cells[..1]].concat();
    let message = frames(&format!("{}\n{}\n", cells.join(","), other.join(","))).unwrap_err();
    assert!(message.starts_with(", row 2: its values have other names than those of the first row"), "{message}");
    let full: Vec<(String, usize)> =
        names.iter().map(|(name, k)| (name.replacen("v_", &format!("ch{k}:"), 1), *k)).collect();
    assert_eq!(read(&header(&full), &values), Ok(expected.clone()), "numbers and electrodes");
    // Other names say nothing where they are in order or have no numbers, and too little where they are not.
    for (of, is_read) in [("ch{}", false), ("d{}_m7", false), ("word", true)] {
        let others = |k: usize| (of.replace("{}", &(k + 2).to_string()), k);
        let (up, down): (Vec<_>, Vec<_>) = ((0..12).map(others).collect(), (0..12).rev().map(others).collect());
        assert_eq!(read(&header(&up), &values).unwrap()[0], 11.5, "{of}");
        let read = read(&header(&down), &values);
        assert!(if is_read { read.is_ok() } else { read.unwrap_err().contains("call them `v_0_1_2_3`") }, "{of}");
    }
    names[0].0 = names[1].0.clone();
    assert!(read(&header(&names), &values).unwrap_err().contains("two columns are named by the electrodes"));
}

#[test]
fn a_result_that_fails_half_way_leaves_the_older_file() {
    let (folder, path) = file("f.csv", "1,2\n");
    let failed = write_whole(&path, |writer| {
        writer.write_all(b"3,")?;
        Err(std::io::Error::other("no space left"))
    });
    assert!(failed.unwrap_err().to_string().contains("f.csv: no space left"));
    assert_eq!(std::fs::read_to_string(&path).unwrap(), "1,2\n");
    assert_eq!(std::fs::read_dir(folder.path()).unwrap().count(), 1, "nothing is left behind");
    let nowhere = folder.path().join("no/such/folder.npy");
    assert!(write_array(&nowhere, "a", &[1], &[1.0]).unwrap_err().to_string().contains("folder.npy"));
}

#[cfg(target_os = "linux")]
#[test]
fn a_full_device_is_an_error_and_stays_a_device() {
    let full = PathBuf::from("/dev/full");
    let error = write_array(&full, "a", &[2, 2], &[1.0; 4]).unwrap_err().to_string();
    assert!(error.starts_with("/dev/full: "), "{error}");
    assert!(!std::fs::metadata(&full).unwrap().is_file());
}

proptest::proptest! {
    /// Any file content gives a table or an error, never a panic.
    #[test]
    fn no_bytes_panic(head in 0_usize..4, tail in proptest::collection::vec(proptest::num::u8::ANY, 0..120)) {
        let mut bytes: Vec<u8> = [&b""[..], b"1,2\n", b"\x93NUMPY\x01\x00\x10\x00{'shape': (", b"PK\x03\x04"][head].to_vec();
        bytes.extend(tail);
        let (_folder, path) = file("f", bytes);
        if let Err(error) = read_table(&path, "frames") {
            let _ = error.to_string();
        }
    }
}
