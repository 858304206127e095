//! Meshes of a URDF: where their files are, and what of them MuJoCo gets.

use std::collections::BTreeMap;
use std::fmt::Write as _;
use std::path::{Path, PathBuf};

/// Most triangles of one mesh: MuJoCo's own limit for files.
const LIMIT_TRIANGLES: usize = 200_000;
/// Largest file that is read.
const LIMIT_BYTES: u64 = 200 << 20;

/// An asset's name and text, or why there is none.
type Met = Result<(String, String), String>;

/// The meshes met so far, by file name and scale.
pub(crate) struct Meshes {
    /// The robot's folder, if it has one: file names are looked for from there.
    folder: Option<PathBuf>,
    /// Whether meshes are used at all.
    used: bool,
    /// Per file name and scale.
    met: BTreeMap<(String, [u64; 3]), Met>,
}

impl Meshes {
    /// Meshes for a robot of that folder.
    pub fn of(folder: Option<&Path>) -> Self {
        Self { folder: folder.map(Path::to_owned), used: true, met: BTreeMap::new() }
    }

    /// None, whatever the URDF names.
    pub fn none() -> Self {
        Self { folder: None, used: false, met: BTreeMap::new() }
    }

    /// The name of the mesh's asset; none if it is left out.
    pub fn name(&mut self, file_name: &str, scale: [f64; 3]) -> Option<String> {
        let number = self.met.len();
        let (folder, used) = (self.folder.as_deref(), self.used);
        let key = (file_name.to_owned(), scale.map(f64::to_bits));
        let met = self.met.entry(key).or_insert_with(|| {
            if !used {
                return Err("MuJoCo takes no such shape".to_owned());
            }
            let file = find(file_name, folder).ok_or("not found")?;
            let name = format!("mesh{number}");
            let text = asset(&name, &file, scale)?;
            Ok((name, text))
        });
        met.as_ref().ok().map(|(name, _)| name.clone())
    }

    /// The assets' text.
    pub fn assets(&self) -> String {
        self.met.values().flatten().map(|(_, text)| text.as_str()).collect()
    }

    /// Whether there is any.
    pub fn any(&self) -> bool {
        self.met.values().any(Result::is_ok)
    }

    /// One line for all meshes that are left out.
    pub fn note(&self) -> Option<String> {
        let left_out: Vec<(&str, &str)> = self
            .met
            .iter()
            .filter_map(|((file, _), met)| Some((file.as_str(), met.as_ref().err()?.as_str())))
            .collect();
        let (file, why) = left_out.first()?;
        let others = match left_out.len() {
            1 => String::new(),
            n => format!(" and {} other(s)", n - 1),
        };
        Some(format!(
            "the mesh \"{file}\" ({why}){others} is left out: not drawn, and touches nothing; package:// is looked for above \
             the robot's folder, in ROS_PACKAGE_PATH and in AMENT_PREFIX_PATH"
        ))
    }
}

/// The file of a mesh: a path, a `file://` or a `package://` address.
fn find(name: &str, folder: Option<&Path>) -> Option<PathBuf> {
    if let Some(path) = name.strip_prefix("file://") {
        return Some(PathBuf::from(path)).filter(|file| file.is_file());
    }
    if let Some(of_package) = name.strip_prefix("package://").or_else(|| name.strip_prefix("model://")) {
        return in_packages(of_package, folder);
    }
    let file = match folder {
        Some(folder) => folder.join(name),
        None => PathBuf::from(name),
    };
    Some(file).filter(|file| file.is_file())
}

/// `PACKAGE/PATH` in the folders that hold packages; the robot's folder and those above it may be the package itself,
/// or hold it.
fn in_packages(of_package: &str, folder: Option<&Path>) -> Option<PathBuf> {
    let (_, inside) = of_package.split_once('/')?;
    let mut places = Vec::new();
    let absolute = folder.and_then(|folder| folder.canonicalize().ok());
    for above in absolute.iter().flat_map(|folder| folder.ancestors()) {
        places.push(above.join(of_package));
        if above.join("package.xml").is_file() || Some(above) == absolute.as_deref() {
            places.push(above.join(inside));
        }
    }
    let listed = |variable: &str, below: &str| -> Vec<PathBuf> {
        let value = std::env::var_os(variable).unwrap_or_default();
        std::env::split_paths(&value).map(|path| path.join(below).join(of_package)).collect()
    };
    places.extend(listed("ROS_PACKAGE_PATH", ""));
    places.extend(listed("AMENT_PREFIX_PATH", "share"));
    places.into_iter().find(|file| file.is_file())
}

/// The mesh as MuJoCo's own text: STL, OBJ and DAE alike, whatever of them MuJoCo itself reads.
fn asset(name: &str, file: &Path, scale: [f64; 3]) -> Result<String, String> {
    let bytes = std::fs::metadata(file).map_err(|error| error.to_string())?.len();
    if bytes > LIMIT_BYTES {
        return Err(format!("{bytes} bytes, at most {LIMIT_BYTES} are read"));
    }
    let scene = mesh_loader::Loader::default().load(file).map_err(|error| error.to_string())?;
    let (mut vertices, mut faces) = (Vec::new(), Vec::new());
    for mesh in &scene.meshes {
        let first = vertices.len() as u32;
        vertices.extend_from_slice(&mesh.vertices);
        faces.extend(mesh.faces.iter().map(|face| face.map(|corner| first + corner)));
    }
    if vertices.len() < 4 || faces.is_empty() || faces.len() > LIMIT_TRIANGLES {
        return Err(format!("{} triangles, expected 1 to {LIMIT_TRIANGLES} on 4 points or more", faces.len()));
    }
    if vertices.iter().flatten().any(|x| !x.is_finite()) {
        return Err("a point is not finite".to_owned());
    }
    if faces.iter().flatten().any(|&corner| corner as usize >= vertices.len()) {
        return Err("a triangle names a point that there is not".to_owned());
    }
    let [x, y, z] = scale;
    // A shell needs no closed surface.
    let mut text = format!(r#"<mesh name="{name}" inertia="shell" scale="{x} {y} {z}" vertex=""#);
    for [x, y, z] in &vertices {
        let _ = write!(text, "{x} {y} {z} ");
    }
    text += r#"" face=""#;
    for [a, b, c] in &faces {
        let _ = write!(text, "{a} {b} {c} ");
    }
    text += "\"/>";
    Ok(text)
}
