//! The system's dialogs to choose files, on threads of their own: the window goes on beside them.

use std::path::PathBuf;
use std::sync::mpsc::{Receiver, Sender, channel};

use egui::Context;
use rfd::{AsyncFileDialog, FileHandle};

/// What a file is chosen for.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Purpose {
    /// Data to be shown.
    Open,
    /// Where the picture is written.
    Picture,
    /// A transfer function to be loaded.
    Function,
    /// Key frames to be loaded.
    Path,
    /// Where the pictures of the key frames are written.
    Film,
}

/// Files that were chosen, and for what.
pub(crate) type Chosen = (Purpose, Vec<PathBuf>);

/// Dialogs, and what was chosen in them.
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
    /// Opens a dialog. Nothing comes of one that is closed, nor where a system has none.
    pub(crate) fn ask(&self, purpose: Purpose, context: &Context) {
        let dialog = AsyncFileDialog::new();
        let (sender, context) = (self.sender.clone(), context.clone());
        // Some systems want it made here and waited for elsewhere.
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
                    Purpose::Film => ("film.apng", &["apng", "gif"][..]),
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

    /// What was chosen since this was last asked.
    pub(crate) fn chosen(&self) -> Vec<Chosen> {
        self.chosen.try_iter().collect()
    }

    /// Where a test says what was chosen.
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
    // A window that was closed takes nothing any more.
    if !paths.is_empty() && sender.send((purpose, paths)).is_ok() {
        context.request_repaint();
    }
}
