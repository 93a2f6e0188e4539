//! Runs the system's file dialogs on threads of their own, so that the window stays responsive.

use std::path::PathBuf;
use std::sync::mpsc::{Receiver, Sender, channel};

use egui::Context;
use rfd::{AsyncFileDialog, FileHandle};

/// Purpose for which a file is chosen.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Purpose {
    /// Data to show.
    Open,
    /// File for the picture.
    Picture,
    /// Transfer function to load.
    Function,
    /// Key frames to load.
    Path,
    /// File for the pictures of the key frames.
    Film,
}

/// Chosen files, with their purpose.
pub(crate) type Chosen = (Purpose, Vec<PathBuf>);

/// Dialogs and the files chosen in them.
#[derive(Debug)]
pub(crate) struct Dialogs {
    sender: Sender<Chosen>,
    chosen: Receiver<Chosen>,
}

impl Default for Dialogs {
    fn default() -> Self {
        let (sender, chosen) = channel();
        Self { sender, chosen }
    }
}

impl Dialogs {
    /// Opens a dialog. A closed dialog, or a system without dialogs, has no effect.
    pub(crate) fn ask(&self, purpose: Purpose, context: &Context) {
        let dialog = AsyncFileDialog::new();
        let (sender, context) = (self.sender.clone(), context.clone());
        // Some systems require that the dialog is created on this thread and awaited on another.
        match purpose {
            Purpose::Open => {
                let files = dialog.set_title("Data to show").pick_files();
                std::thread::spawn(move || {
                    tell(purpose, pollster::block_on(files), &sender, &context)
                });
            }
            Purpose::Function | Purpose::Path => {
                let file = dialog.add_filter("JSON", &["json"]).pick_file();
                std::thread::spawn(move || {
                    let file = pollster::block_on(file).map(|file| vec![file]);
                    tell(purpose, file, &sender, &context);
                });
            }
            Purpose::Picture | Purpose::Film => {
                let (name, endings) = match purpose {
                    Purpose::Film => ("film.apng", &["mp4", "apng", "gif"][..]),
                    _ => ("picture.png", &["png", "exr", "pfm", "npy"][..]),
                };
                let dialog = dialog.set_file_name(name).add_filter("pictures", endings);
                let file = dialog.save_file();
                std::thread::spawn(move || {
                    let file = pollster::block_on(file).map(|file| vec![file]);
                    tell(purpose, file, &sender, &context);
                });
            }
        }
    }

    /// Returns the files chosen since the last call.
    pub(crate) fn chosen(&self) -> Vec<Chosen> {
        self.chosen.try_iter().collect()
    }

    /// Returns the channel through which a test makes choices.
    #[cfg(test)]
    pub(crate) fn sender(&self) -> Sender<Chosen> {
        self.sender.clone()
    }
}

fn tell(
    purpose: Purpose,
    files: Option<Vec<FileHandle>>,
    sender: &Sender<Chosen>,
    context: &Context,
) {
    let files = files.into_iter().flatten();
    let paths: Vec<PathBuf> = files.map(|file| file.path().to_path_buf()).collect();
    // A closed window no longer receives choices.
    if !paths.is_empty() && sender.send((purpose, paths)).is_ok() {
        context.request_repaint();
    }
}
