//! Suppresses messages that graphics drivers print.

/// Suppresses Mesa's complaints on machines without a desktop.
///
/// Mesa's device-selection layer asks a Wayland display for its device. It complains on standard
/// error if `XDG_RUNTIME_DIR`, the folder of display sockets, is unset or not an absolute path. If
/// the variable names an absent folder, Mesa takes it that there is no display and is silent. Real
/// errors are still printed, and the layer's own variables (`MESA_VK_DEVICE_SELECT`, `DRI_PRIME`)
/// still apply.
///
/// Call this first in `main`, before any thread is started: it may set that variable.
#[cfg(all(unix, not(target_vendor = "apple")))]
pub fn quiet_drivers() {
    const VARIABLE: &str = "XDG_RUNTIME_DIR";
    let folder = std::env::var_os(VARIABLE);
    if !folder.is_some_and(|folder| std::path::Path::new(&folder).is_absolute()) {
        // SAFETY: `main` calls this first. No thread has been started that could read or write the
        // environment meanwhile.
        #[expect(
            unsafe_code,
            reason = "drivers read the environment of their own process, and there is no other way to set it"
        )]
        unsafe {
            std::env::set_var(VARIABLE, "/nonexistent");
        }
    }
}

/// Does nothing: drivers of other systems print no such messages.
#[cfg(not(all(unix, not(target_vendor = "apple"))))]
pub fn quiet_drivers() {}
