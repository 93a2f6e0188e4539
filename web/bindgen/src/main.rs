//! Writes the JavaScript and the types of a compiled module: `bindgen MODULE.wasm NAME FOLDER`.

use std::process::ExitCode;

use wasm_bindgen_cli_support::Bindgen;

fn main() -> ExitCode {
    let arguments: Vec<String> = std::env::args().skip(1).collect();
    let [module, name, folder] = arguments.as_slice() else {
        eprintln!("usage: bindgen MODULE.wasm NAME FOLDER");
        return ExitCode::from(2);
    };
    let mut bindgen = Bindgen::new();
    let written = bindgen
        .input_path(module)
        .out_name(name)
        .web(true)
        .and_then(|bindgen| {
            // Names of functions take a tenth of the module.
            let bindgen = bindgen
                .remove_name_section(true)
                .remove_producers_section(true);
            // Without an argument, the module is loaded from beside its script.
            let bindgen = bindgen.omit_default_module_path(false);
            bindgen.typescript(true).generate(folder)
        });
    match written {
        Ok(()) => ExitCode::SUCCESS,
        Err(error) => {
            eprintln!("{error:#}");
            ExitCode::FAILURE
        }
    }
}
