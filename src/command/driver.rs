//! What drivers print unasked.

/// Keeps Mesa quiet where there is no desktop.
///
/// Its layer for choosing devices asks a Wayland display for its own and complains on standard error where
/// `XDG_RUNTIME_DIR`, in which displays are found, is unset or no absolute path. Where it names a
/// folder that does not exist there is just no display, which is true; real errors are still printed, and
/// the layer's own variables (`MESA_VK_DEVICE_SELECT`, `DRI_PRIME`) hold.
///
/// To be called first of all in `main`, before any thread is started: it may set that variable.
#[cfg(all(unix, not(target_vendor = "apple")))]
pub fn quiet_drivers() {
    const VARIABLE: &str = "XDG_RUNTIME_DIR";
    let folder = std::env::var_os(VARIABLE);
    if !folder.is_some_and(|folder| std::path::Path::new(&folder).is_absolute()) {
        // SAFETY: this is the first that `main` does: no thread has been started that could read or write
        // the environment meanwhile.
        #[expect(
            unsafe_code,
            reason = "drivers read the environment of their own process, and there is no other way to set it"
        )]
        unsafe {
            std::env::set_var(VARIABLE, "/nonexistent");
        }
    }
}

/// Does nothing: other systems' drivers are quiet.
#[cfg(not(all(unix, not(target_vendor = "apple"))))]
pub fn quiet_drivers() {}
