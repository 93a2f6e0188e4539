//! Writes OpenFOAM cases in every form that its files have.

use super::gzip;

/// Form of a case's files.
#[derive(Debug, Clone, Copy, Default)]
pub(crate) struct Form {
    pub(crate) binary: bool,
    pub(crate) big_endian: bool,
    /// True for labels of 64 and numbers of 32 bits, instead of 32 and 64.
    pub(crate) is_swapped: bool,
    pub(crate) compact: bool,
    pub(crate) packed: bool,
}

/// Mesh by its nodes and the faces of each cell. A face's nodes are anticlockwise, seen from
/// outside.
pub(crate) struct Mesh {
    pub(crate) nodes: Vec<[f64; 3]>,
    pub(crate) cells: Vec<Vec<Vec<usize>>>,
}

/// Returns a hexahedron with a pyramid on top, a tetrahedron on the pyramid, a wedge at the side,
/// and a pentagonal prism below.
pub(crate) fn zoo() -> Mesh {
    let nodes = [
        [0., 0., 0.],
        [1., 0., 0.],
        [1., 1., 0.],
        [0., 1., 0.],
        [0., 0., 1.],
        [1., 0., 1.],
        [1., 1., 1.],
        [0., 1., 1.],
        [0.5, 0.5, 2.],
        [2., 0.5, 1.5],
        [2., 0., 0.5],
        [2., 1., 0.5],
        [1.25, 0., -1.],
        [0.5, 0., -1.5],
        [-0.25, 0., -1.],
        [1.25, 1., -1.],
        [0.5, 1., -1.5],
        [-0.25, 1., -1.],
    ];
    let cells: [&[&[usize]]; 5] = [
        &[
            &[0, 3, 2, 1],
            &[4, 5, 6, 7],
            &[0, 1, 5, 4],
            &[3, 7, 6, 2],
            &[0, 4, 7, 3],
            &[1, 2, 6, 5],
        ],
        &[
            &[4, 7, 6, 5],
            &[4, 5, 8],
            &[5, 6, 8],
            &[6, 7, 8],
            &[7, 4, 8],
        ],
        &[&[5, 8, 6], &[5, 9, 8], &[6, 8, 9], &[5, 6, 9]],
        &[
            &[1, 5, 6, 2],
            &[1, 10, 5],
            &[2, 6, 11],
            &[1, 2, 11, 10],
            &[5, 10, 11, 6],
        ],
        &[
            &[0, 1, 2, 3],
            &[0, 14, 13, 12, 1],
            &[3, 2, 15, 16, 17],
            &[1, 12, 15, 2],
            &[12, 13, 16, 15],
            &[13, 14, 17, 16],
            &[14, 0, 3, 17],
        ],
    ];
    Mesh {
        nodes: nodes.to_vec(),
        cells: cells
            .iter()
            .map(|faces| faces.iter().map(|face| face.to_vec()).collect())
            .collect(),
    }
}

impl Form {
    /// Returns all forms that differ in more than their compression.
    pub(crate) fn all() -> Vec<Self> {
        let mut forms = vec![Self::default()];
        for bits in 0..8 {
            let is = |bit: i32| bits >> bit & 1 == 1;
            forms.push(Self {
                binary: true,
                big_endian: is(0),
                is_swapped: is(1),
                compact: is(2),
                packed: is(0),
            });
        }
        forms
    }

    fn file(self, name: &str, class: &str, body: &[u8]) -> (String, Vec<u8>) {
        let format = if self.binary { "binary" } else { "ascii" };
        let order = if self.big_endian { "MSB" } else { "LSB" };
        let bits = if self.is_swapped { [64, 32] } else { [32, 64] };
        let [label, scalar] = bits;
        let object = name.rsplit('/').next().unwrap();
        let header = format!(
            "/* made */\nFoamFile\n{{\n    version 2.0;\n    format {format};\n    arch \"{order};label={label};scalar={scalar}\";\n    \
             class {class}; // of it\n    object {object};\n}}\n\n"
        );
        let bytes = [header.as_bytes(), body].concat();
        match self.packed && !name.starts_with("system") {
            true => (format!("{name}.gz"), gzip(&bytes)),
            false => (name.to_owned(), bytes),
        }
    }

    fn ordered(self, mut bytes: Vec<u8>) -> Vec<u8> {
        if self.big_endian {
            bytes.reverse();
        }
        bytes
    }

    fn label(self, number: usize) -> Vec<u8> {
        let bytes = (number as u64).to_le_bytes();
        self.ordered(bytes[..if self.is_swapped { 8 } else { 4 }].to_vec())
    }

    fn scalar(self, number: f64) -> Vec<u8> {
        self.ordered(match self.is_swapped {
            true => (number as f32).to_le_bytes().to_vec(),
            false => number.to_le_bytes().to_vec(),
        })
    }

    fn labels(self, labels: &[usize]) -> Vec<u8> {
        let mut out = format!("{}\n(", labels.len()).into_bytes();
        for label in labels {
            match self.binary {
                true => out.extend(self.label(*label)),
                false => out.extend(format!("{label} ").bytes()),
            }
        }
        out.extend(b")\n");
        out
    }

    /// Writes a list of values with the given number of components.
    pub(crate) fn values(self, numbers: &[f64], components: usize) -> Vec<u8> {
        let mut out = format!("{}\n(", numbers.len() / components).into_bytes();
        for value in numbers.chunks(components) {
            let text: Vec<String> = value.iter().map(f64::to_string).collect();
            match (self.binary, components) {
                (true, _) => out.extend(value.iter().flat_map(|&x| self.scalar(x))),
                (false, 1) => out.extend(format!("{}\n", text[0]).bytes()),
                (false, _) => out.extend(format!("({})\n", text.join(" ")).bytes()),
            }
        }
        out.extend(b")\n");
        out
    }

    /// Writes a field of numbers, value after value.
    pub(crate) fn field(
        self,
        name: &str,
        class: &str,
        components: usize,
        numbers: &[f64],
    ) -> (String, Vec<u8>) {
        let list = self.values(numbers, components);
        let of = match components {
            1 => "scalar",
            3 => "vector",
            _ => "symmTensor",
        };
        let start = format!("dimensions [0 1 -1 0 0 0 0];\ninternalField nonuniform List<{of}>\n");
        let body = [
            start.as_bytes(),
            &list[..],
            b";\nboundaryField { walls { type zeroGradient; } }\n",
        ];
        self.file(name, class, &body.concat())
    }

    /// Returns the files of a mesh's folder.
    pub(crate) fn mesh(self, folder: &str, mesh: &Mesh) -> Vec<(String, Vec<u8>)> {
        // Faces between cells come first, then those of the boundary.
        let mut inner: Vec<(&Vec<usize>, usize, usize)> = Vec::new();
        let mut outer: Vec<(&Vec<usize>, usize)> = Vec::new();
        for (cell, faces) in mesh.cells.iter().enumerate() {
            for face in faces {
                let is_same = |other: &&Vec<usize>| {
                    let sorted = |f: &[usize]| {
                        let mut sorted = f.to_vec();
                        sorted.sort_unstable();
                        sorted
                    };
                    sorted(other) == sorted(face)
                };
                match outer.iter().position(|(other, _)| is_same(other)) {
                    Some(at) => {
                        let (face, owner) = outer.remove(at);
                        inner.push((face, owner, cell));
                    }
                    None => outer.push((face, cell)),
                }
            }
        }
        let faces: Vec<&Vec<usize>> = inner
            .iter()
            .map(|(f, ..)| *f)
            .chain(outer.iter().map(|(f, _)| *f))
            .collect();
        let owners: Vec<usize> = inner
            .iter()
            .map(|(_, owner, _)| *owner)
            .chain(outer.iter().map(|(_, owner)| *owner))
            .collect();
        let neighbours: Vec<usize> = inner.iter().map(|(.., cell)| *cell).collect();
        let (class, list) = if self.compact {
            let mut starts = vec![0];
            starts.extend(faces.iter().scan(0, |end, face| {
                *end += face.len();
                Some(*end)
            }));
            let nodes: Vec<usize> = faces.iter().flat_map(|f| f.iter().copied()).collect();
            let lists = [self.labels(&starts), self.labels(&nodes)];
            ("faceCompactList", lists.concat())
        } else {
            let mut list = format!("{}\n(\n", faces.len()).into_bytes();
            list.extend(faces.iter().flat_map(|face| self.labels(face)));
            list.extend(b")\n");
            ("faceList", list)
        };
        let name = |file: &str| format!("{folder}/polyMesh/{file}");
        let (start, count) = (inner.len(), outer.len());
        let boundary = format!("1(walls {{ type wall; nFaces {count}; startFace {start}; }})\n");
        vec![
            self.file(
                &name("points"),
                "vectorField",
                &self.values(&mesh.nodes.concat(), 3),
            ),
            self.file(&name("faces"), class, &list),
            self.file(&name("owner"), "labelList", &self.labels(&owners)),
            self.file(&name("neighbour"), "labelList", &self.labels(&neighbours)),
            self.file(&name("boundary"), "polyBoundaryMesh", boundary.as_bytes()),
        ]
    }

    /// Returns `system/controlDict`, which stands for the case.
    pub(crate) fn control(self) -> (String, Vec<u8>) {
        self.file("system/controlDict", "dictionary", b"endTime 1;\n")
    }

    /// Returns a case of [`zoo`] with two times and fields of all kinds. The file to open comes
    /// first.
    pub(crate) fn case(self) -> Vec<(String, Vec<u8>)> {
        let mut files = vec![self.control()];
        files.extend(self.mesh("constant", &zoo()));
        let uniform = b"dimensions [1 -1 -2 0 0];\ninternalField uniform 2.5;\n";
        files.push(self.file("0/p", "volScalarField", uniform));
        let uniform = b"internalField uniform (1 2 3);\n";
        files.push(self.file("0/U", "volVectorField", uniform));
        let numbers = |count: i32| -> Vec<f64> { (0..count).map(|i| f64::from(i) / 4.0).collect() };
        files.push(self.field("0.5/p", "volScalarField", 1, &numbers(5)));
        files.push(self.field("0.5/U", "volVectorField", 3, &numbers(15)));
        files.push(self.field("0.5/R", "volSymmTensorField", 6, &numbers(30)));
        files.push(self.field("0.5/D", "pointVectorField", 3, &numbers(54)));
        files.push(self.field("0.5/phi", "surfaceScalarField", 1, &numbers(4)));
        let computed = b"internalField #calc \"sin(1.0)\";\n";
        files.push(self.file("0.5/calculated", "volScalarField", computed));
        files
    }

    /// Returns the case decomposed into two pieces: the hexahedron, and the rest.
    pub(crate) fn decomposed(self) -> Vec<(String, Vec<u8>)> {
        let mut files = vec![self.control()];
        let whole = zoo();
        for (i, cells) in [&whole.cells[..1], &whole.cells[1..]]
            .into_iter()
            .enumerate()
        {
            let piece = Mesh {
                nodes: whole.nodes.clone(),
                cells: cells.to_vec(),
            };
            files.extend(self.mesh(&format!("processor{i}/constant"), &piece));
            let numbers: Vec<f64> = (0..cells.len()).map(|c| (10 * i + c) as f64).collect();
            let name = format!("processor{i}/1e-3/p");
            files.push(self.field(&name, "volScalarField", 1, &numbers));
        }
        files.push(self.field("processor0/1e-3/q", "volScalarField", 1, &[1.0]));
        files
    }
}
