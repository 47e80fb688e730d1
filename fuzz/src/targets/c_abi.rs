//! The C interface: bytes are a program of calls with good, stale, foreign and made-up handles, NULLs and wrong sizes, against a
//! stand-in daemon in the same process. What C promises is kept: buffers are as long as the calls are told.

#![allow(unsafe_code)] // calls into the C interface

use beo_ipc::{InstanceName, ObservationHeader, Percept, Server, ServerOptions, Status};
// Linked for its exported functions.
use beo_c_abi as _;
use std::cell::RefCell;
use std::ffi::{CString, c_char, c_int, c_void};
use std::ptr::{null, null_mut, without_provenance_mut};

type Handle = *mut c_void;

/// `beo_completion_view`.
#[repr(C)]
struct View {
    size: u32,
    reserved: u32,
    voxel_count: usize,
    occupancy: *const u8,
    deviation: *const u8,
    header: beo_ipc::CompletionHeader,
}

/// `beo_depth_frame`.
#[repr(C)]
struct DepthFrame {
    size: u32,
    reserved: u32,
    side: [u32; 2],
    camera: [f64; 9],
    depth_m: *const f32,
    depth_count: usize,
    labels: *const u16,
    label_count: usize,
}

/// `beo_camera_options`.
#[repr(C)]
#[derive(Clone, Copy)]
struct CameraOptions {
    size: u32,
    support_label: u32,
    sensor: [f64; 3],
    up: [f64; 3],
    share: f64,
    known_side_m: f64,
    known_side_deviation_m: f64,
    least_readings: u32,
    reserved: u32,
}

/// `beo_plane`.
type Plane = [f64; 4];

/// `beo_grid`.
#[repr(C)]
#[derive(Clone, Copy)]
struct Grid {
    dims: [u32; 3],
    cut: u32,
    voxel_size_m: f64,
    position_m: [f64; 3],
    orientation: [f64; 4],
    shares: [f64; 3],
    surface_deviation_m: f64,
}

unsafe extern "C" {
    safe fn beo_status_text(status: i32) -> *const c_char;
    safe fn beo_last_error() -> *const c_char;
    fn beo_observation_header_init(header: *mut ObservationHeader, nx: u32, ny: u32, nz: u32) -> i32;
    fn beo_producer_open(instance: *const c_char, nx: u32, ny: u32, nz: u32, options: *const u8, producer: *mut Handle) -> i32;
    safe fn beo_producer_close(producer: Handle) -> i32;
    fn beo_producer_id(producer: Handle, id: *mut u64) -> i32;
    fn beo_producer_loan(producer: Handle, loan: *mut Handle, voxels: *mut *mut u8, count: *mut usize) -> i32;
    fn beo_loan_commit(loan: Handle, header: *const ObservationHeader, sequence: *mut u64) -> i32;
    safe fn beo_loan_abandon(loan: Handle) -> i32;
    fn beo_subscriber_open(instance: *const c_char, options: *const u8, subscriber: *mut Handle) -> i32;
    safe fn beo_subscriber_close(subscriber: Handle) -> i32;
    safe fn beo_subscriber_wait(subscriber: Handle, timeout_ms: i32) -> i32;
    fn beo_subscriber_file_descriptor(subscriber: Handle, descriptor: *mut c_int) -> i32;
    fn beo_subscriber_take_percept(subscriber: Handle, percept: *mut Percept) -> i32;
    fn beo_subscriber_take_completion(subscriber: Handle, completion: *mut Handle, view: *mut View) -> i32;
    fn beo_subscriber_status(subscriber: Handle, status: *mut Status, age: *mut u64) -> i32;
    safe fn beo_completion_release(completion: Handle) -> i32;
    fn beo_depth_from_u16(depth: *const u16, count: usize, scale_m: f64, depth_m: *mut f32) -> i32;
    fn beo_fit_support(frame: *const DepthFrame, options: *const CameraOptions, plane: *mut Plane) -> i32;
    fn beo_segment_table(
        frame: *const DepthFrame,
        options: *const CameraOptions,
        labels: *mut u16,
        label_count: usize,
        object_count: *mut u32,
    ) -> i32;
    fn beo_place_grid(
        frame: *const DepthFrame,
        options: *const CameraOptions,
        object: u16,
        support: *const Plane,
        nx: u32,
        ny: u32,
        nz: u32,
        grid: *mut Grid,
    ) -> i32;
    fn beo_carve(
        frame: *const DepthFrame,
        options: *const CameraOptions,
        object: u16,
        support: *const Plane,
        grid: *const Grid,
        voxels: *mut u8,
        voxel_count: usize,
    ) -> i32;
    fn beo_observation_header_of_grid(grid: *const Grid, options: *const CameraOptions, header: *mut ObservationHeader) -> i32;
    fn beo_perceive_with(
        producer: Handle,
        subscriber: Handle,
        header: *const ObservationHeader,
        voxels: *const u8,
        count: usize,
        timeout_ms: i32,
        percept: *mut Percept,
    ) -> i32;
}

const SIDE: u32 = 8;
const VOXELS: usize = (SIDE * SIDE * SIDE) as usize;
const SLOTS: usize = 8;
/// `BEO_STATUS_INTERNAL`: a panic inside the library.
const INTERNAL: i32 = -13;

/// The stand-in daemon, opened once: its segments cost more than a program.
struct World {
    server: Server,
    /// A producer and a subscriber that programs begin with, as opening takes longer than all else.
    open: [Handle; 2],
    instance: CString,
}

thread_local! {
    static WORLD: RefCell<Option<World>> = const { RefCell::new(None) };
}

/// Runs the program that the bytes are.
pub fn run(data: &[u8]) {
    WORLD.with_borrow_mut(|world| {
        let world = world.get_or_insert_with(World::open);
        let mut slots = [null_mut(); SLOTS];
        world.reopen();
        slots[..2].copy_from_slice(&world.open);
        let mut program = Program { left: data };
        while let Some(operation) = program.byte() {
            let status = world.call(operation, &mut program, &mut slots);
            assert_ne!(status, INTERNAL, "operation {operation}: {:?}", text(beo_last_error()));
            assert!(!text(beo_status_text(status)).contains("unknown"), "operation {operation} gives {status}");
        }
        for handle in slots.into_iter().filter(|handle| !world.open.contains(handle)) {
            assert!(close(handle) <= 1, "a handle is of one kind");
        }
        world.pump();
    });
}

/// Closes a handle of whatever kind; how many kinds knew it.
fn close(handle: Handle) -> usize {
    [beo_loan_abandon, beo_completion_release, beo_subscriber_close, beo_producer_close].iter().filter(|end| end(handle) == 0).count()
}

fn text<'a>(pointer: *const c_char) -> &'a str {
    // SAFETY: a text of the library, which lives until the thread's next failure.
    unsafe { std::ffi::CStr::from_ptr(pointer) }.to_str().expect("UTF-8")
}

/// The operation that a byte stands for. Opening and closing producers and subscribers takes longer than all else: one byte stands for each of them,
/// and many for the others.
fn operation_of(byte: u8) -> u8 {
    match (byte, byte % 19) {
        (0..19, own) => own,
        (_, 0) => 2,
        (_, 1) => 10,
        (_, 7) => 6,
        (_, 8) => 12,
        (_, other) => other,
    }
}

struct Program<'a> {
    left: &'a [u8],
}

impl Program<'_> {
    fn byte(&mut self) -> Option<u8> {
        let (first, rest) = self.left.split_first()?;
        self.left = rest;
        Some(*first)
    }

    fn next(&mut self) -> u8 {
        self.byte().unwrap_or_default()
    }

    /// One of the handles, or what never was one.
    fn handle(&mut self, slots: &[Handle; SLOTS]) -> Handle {
        match self.next() {
            choice @ 0..128 => slots[usize::from(choice) % SLOTS],
            choice @ 128..192 => without_provenance_mut(usize::from(choice - 127)),
            choice @ 192..224 => without_provenance_mut(usize::MAX - usize::from(choice)),
            _ => null_mut(),
        }
    }

    /// Whether an argument is given: mostly.
    fn given(&mut self) -> bool {
        self.next() < 224
    }

    /// Options of some size, in a buffer of that size where the size is right.
    fn options(&mut self, right: u32) -> [u8; 64] {
        let mut options = [0; 64];
        let size = if self.given() { right } else { u32::from(self.next()) % 64 };
        options[..4].copy_from_slice(&size.to_le_bytes());
        // Completions for subscribers; no waiting.
        if right == 16 {
            options[4] = self.next() % 3;
        }
        options
    }

    /// A number: mostly the one that is right.
    fn number(&mut self, right: f64) -> f64 {
        match self.next() {
            0..200 => right,
            200..230 => right * f64::from(self.next()) / 16.0 - 1.0,
            choice => [0.0, -1.0, f64::NAN, f64::INFINITY, f64::MAX, f64::MIN_POSITIVE, 1e-300, -1e150][usize::from(choice) % 8],
        }
    }

    /// From a frame to a grid and its header: the last status. What comes out of one call goes into the next, also after errors.
    fn look(&mut self) -> i32 {
        const COLUMNS: usize = 24;
        const PIXELS: usize = COLUMNS * 16;
        let readings: [u16; PIXELS] =
            std::array::from_fn(|i| 800 + (i / COLUMNS) as u16 * u16::from(self.left.first().copied().unwrap_or(9)));
        let labels: [u16; PIXELS] =
            std::array::from_fn(|i| u16::from((8..16).contains(&(i % COLUMNS)) && (4..12).contains(&(i / COLUMNS))));
        let mut depth = [0.0_f32; PIXELS];
        let scale = self.number(0.001);
        // SAFETY: as many numbers as said.
        let mut status = unsafe { beo_depth_from_u16(readings.as_ptr(), PIXELS, scale, depth.as_mut_ptr()) };
        for _ in 0..self.next() % 8 {
            let place = usize::from(self.next()) % PIXELS;
            depth[place] = self.number(1.0) as f32;
        }
        let camera = [20.0, 20.0, 11.5, 7.5, 0.0, 0.0, 0.0, 0.0, 0.0].map(|right| self.number(right));
        let frame = DepthFrame {
            size: if self.given() { size_of::<DepthFrame>() as u32 } else { self.next().into() },
            reserved: 0,
            side: [COLUMNS as u32, if self.given() { 16 } else { self.next().into() }],
            camera,
            depth_m: if self.given() { depth.as_ptr() } else { null() },
            depth_count: PIXELS,
            labels: if self.given() { labels.as_ptr() } else { null() },
            label_count: if self.given() { PIXELS } else { self.next().into() },
        };
        let options = CameraOptions {
            size: if self.given() { size_of::<CameraOptions>() as u32 } else { self.next().into() },
            support_label: if self.given() { 0 } else { self.next().into() },
            sensor: [0.001, 0.0019, 2.0].map(|right| self.number(right)),
            up: [0.0, -1.0, -1.0].map(|right| self.number(right)),
            share: self.number(0.7),
            known_side_m: self.number(0.0),
            known_side_deviation_m: self.number(0.0),
            least_readings: self.next().into(),
            reserved: 0,
        };
        let (frame, options) = (&raw const frame, if self.given() { &raw const options } else { null() });
        let mut plane = [0.0, -0.6, -0.8, 0.9].map(|right| self.number(right));
        let mut grid = Grid {
            dims: [SIDE; 3],
            cut: if self.given() { 0 } else { self.next().into() },
            voxel_size_m: self.number(0.02),
            position_m: [0.0, 0.0, 0.9].map(|right| self.number(right)),
            orientation: [0.0, 0.0, 0.0, 1.0].map(|right| self.number(right)),
            shares: [0.25, 0.0, 0.5].map(|right| self.number(right)),
            surface_deviation_m: self.number(0.002),
        };
        let (mut voxels, mut header) = ([7; VOXELS], ObservationHeader::new([SIDE; 3]));
        // SAFETY: NULL, or locals that outlive the calls; images and voxels have as many values as is said, or more.
        unsafe {
            for _ in 0..self.next() % 6 {
                let support = if self.given() { &raw const plane } else { null() };
                status = match self.next() % 5 {
                    0 => beo_fit_support(frame, options, if self.given() { &raw mut plane } else { null_mut() }),
                    1 => {
                        let side = if self.given() { SIDE } else { self.next().into() };
                        let status = beo_place_grid(frame, options, 1, support, side, SIDE, SIDE, &raw mut grid);
                        assert!(status != 0 || (grid.voxel_size_m > 0.0 && grid.position_m.iter().all(|value| value.is_finite())));
                        status
                    }
                    2 => {
                        let count = if self.given() { VOXELS } else { self.next().into() };
                        let status = beo_carve(frame, options, 1, support, &raw const grid, voxels.as_mut_ptr(), count);
                        assert!(status != 0 || voxels.iter().all(|code| [0, 1, 255].contains(code)), "all voxels are written");
                        status
                    }
                    3 => {
                        let (mut segments, mut objects) = ([0_u16; PIXELS], 0_u32);
                        let count = if self.given() { PIXELS } else { usize::from(self.next()) };
                        let status = beo_segment_table(frame, options, segments.as_mut_ptr(), count, &raw mut objects);
                        assert!(status != 0 || segments.iter().all(|label| u32::from(*label) <= objects), "1 to the number of objects");
                        status
                    }
                    _ => {
                        let status = beo_observation_header_of_grid(&raw const grid, options, &raw mut header);
                        assert!(status != 0 || header.sensor_position_m.iter().all(|value| value.is_finite()));
                        status
                    }
                };
                assert_ne!(status, INTERNAL, "{:?}", text(beo_last_error()));
            }
        }
        status
    }

    fn header(&mut self) -> ObservationHeader {
        let mut header = ObservationHeader::new([SIDE; 3]);
        for _ in 0..self.next() % 4 {
            let value = f64::from(self.next());
            match self.next() % 8 {
                0 => header.dims[0] = value as u32,
                1 => header.abi_version = value as u32,
                2 => header.voxel_size_m = value as f32 - 1.0,
                3 => header.orientation = [f64::NAN, value, 0.0, 0.0],
                4 => header.tasks = value as u32,
                5 => header.capture_ns = u64::MAX,
                6 => header.rotation_prior_concentration = f32::NAN,
                _ => header.pose_search = value as u32,
            }
        }
        header
    }
}

impl Drop for World {
    /// The library's tables would keep what is open beyond the end of the process.
    fn drop(&mut self) {
        self.open.into_iter().for_each(|handle| {
            close(handle);
        });
    }
}

impl World {
    fn open() -> Self {
        let name = format!("fuzz-{}", std::process::id());
        let instance = InstanceName::new(&name).expect("a name");
        let server = Server::open(&instance, &ServerOptions::new([SIDE; 3])).expect("shared memory");
        server.publish_status(&Status::EMPTY).expect("a status");
        Self { server, open: [null_mut(); 2], instance: CString::new(name).expect("no NUL") }
    }

    /// Opens anew what a program has closed.
    fn reopen(&mut self) {
        let instance = self.instance.as_ptr();
        let [producer, subscriber] = &mut self.open;
        // SAFETY: a text of this process, no options, and writable places.
        unsafe {
            if beo_producer_id(*producer, &mut 0) != 0 {
                assert_eq!(beo_producer_open(instance, SIDE, SIDE, SIDE, null(), producer), 0, "{}", text(beo_last_error()));
            }
            if beo_subscriber_wait(*subscriber, 0) < 0 {
                assert_eq!(beo_subscriber_open(instance, null(), subscriber), 0, "{}", text(beo_last_error()));
            }
        }
    }

    /// Answers what has arrived.
    fn pump(&self) {
        while let Ok(Some(observation)) = self.server.receive() {
            let percept = match observation.voxels() {
                Ok(voxels) => {
                    let mut loan = self.server.loan_completion(observation.header()).expect("nobody holds many");
                    let (occupancy, deviation) = loan.occupancy_and_deviation_mut();
                    occupancy.copy_from_slice(voxels);
                    deviation.fill(0);
                    loan.send().expect("delivered");
                    Percept::answering(observation.header())
                }
                Err(refusal) => Percept::refusing(observation.header(), &refusal),
            };
            self.server.publish(&percept).expect("delivered");
        }
    }

    fn call(&self, operation: u8, program: &mut Program<'_>, slots: &mut [Handle; SLOTS]) -> i32 {
        let made = usize::from(program.next()) % SLOTS;
        let handle = program.handle(slots);
        let mut new = null_mut();
        let new_at: *mut Handle = if program.given() { &mut new } else { null_mut() };
        let name = match program.next() {
            0..200 => self.instance.clone(),
            200..240 => CString::new(vec![program.next().max(1); usize::from(program.next())]).expect("no NUL"),
            _ => CString::default(),
        };
        let mut percept = Percept::EMPTY;
        let percept_at: *mut Percept = if program.given() { &mut percept } else { null_mut() };
        // What is overwritten is closed first: a program cannot hold more than the slots.
        let keep = |slots: &mut [Handle; SLOTS], new: Handle| {
            if !new.is_null() {
                let old = std::mem::replace(&mut slots[made], new);
                close(old);
            }
        };
        // SAFETY: every pointer is NULL or leads to a local of the right type that outlives the call; slices are as long as said.
        unsafe {
            match operation_of(operation) {
                0 => {
                    let options = program.options(8);
                    let options = if program.given() { options.as_ptr() } else { null() };
                    let side = if program.given() { SIDE } else { u32::from(program.next()) };
                    let status = beo_producer_open(name.as_ptr(), SIDE, side, SIDE, options, new_at);
                    keep(slots, new);
                    status
                }
                1 => {
                    let options = program.options(16);
                    let options = if program.given() { options.as_ptr() } else { null() };
                    let status = beo_subscriber_open(name.as_ptr(), options, new_at);
                    keep(slots, new);
                    status
                }
                2 | 3 => {
                    let (mut voxels, mut count) = (null_mut(), 0);
                    let voxels_at = if program.given() { &raw mut voxels } else { null_mut() };
                    let status = beo_producer_loan(handle, new_at, voxels_at, &mut count);
                    if status == 0 && !voxels.is_null() {
                        std::ptr::write_bytes(voxels, program.next(), count);
                    }
                    keep(slots, new);
                    status
                }
                4 | 5 => {
                    let header = program.header();
                    let mut sequence = 0;
                    let header_at = if program.given() { &raw const header } else { null() };
                    beo_loan_commit(handle, header_at, if program.given() { &mut sequence } else { null_mut() })
                }
                6 => beo_loan_abandon(handle),
                7 => beo_producer_close(handle),
                8 => beo_subscriber_close(handle),
                9 => beo_subscriber_wait(handle, i32::from(program.next() % 2)),
                10 => beo_subscriber_take_percept(handle, percept_at),
                11 => {
                    let mut view: View = std::mem::zeroed();
                    view.size = if program.given() { size_of::<View>() as u32 } else { u32::from(program.next()) };
                    let status = beo_subscriber_take_completion(handle, new_at, if program.given() { &mut view } else { null_mut() });
                    if status == 0 {
                        let bytes = std::slice::from_raw_parts(view.occupancy, view.voxel_count);
                        std::hint::black_box(bytes.iter().map(|b| u64::from(*b)).sum::<u64>());
                    }
                    keep(slots, new);
                    status
                }
                12 => beo_completion_release(handle),
                13 => {
                    let (mut status, mut age) = (Status::EMPTY, 0);
                    let status_at = if program.given() { &raw mut status } else { null_mut() };
                    beo_subscriber_status(handle, status_at, if program.given() { &mut age } else { null_mut() })
                }
                14 => {
                    let mut descriptor = 0;
                    beo_subscriber_file_descriptor(handle, if program.given() { &mut descriptor } else { null_mut() })
                }
                15 => {
                    let mut id = 0;
                    let mut header = ObservationHeader::new([SIDE; 3]);
                    let header_at = if program.given() { &raw mut header } else { null_mut() };
                    beo_observation_header_init(header_at, u32::from(program.next()), SIDE, SIDE);
                    beo_producer_id(handle, if program.given() { &mut id } else { null_mut() })
                }
                16 => {
                    let header = program.header();
                    let voxels = [program.next(); VOXELS];
                    let count = if program.given() { VOXELS } else { usize::from(program.next()) };
                    let header_at = if program.given() { &raw const header } else { null() };
                    let other = program.handle(slots);
                    beo_perceive_with(handle, other, header_at, voxels.as_ptr(), count, i32::from(program.next() % 2), percept_at)
                }
                17 => {
                    self.pump();
                    0
                }
                _ => program.look(),
            }
        }
    }
}

/// The channels of a few producers and subscribers.
pub fn most_bytes(len: usize) -> usize {
    1024 * len + (64 << 20)
}

/// Seeds: open, loan, commit, answer, take, release, close; then the same out of order.
pub fn seeds() -> Vec<Vec<u8>> {
    // Operation, slot for what it makes, handle; zeros are arguments as they should be.
    let line = |operation: u8, made: u8, handle: u8| [operation, made, handle, 0, 0, 0, 0, 0, 0, 0, 0, 0];
    let calls = |calls: &[(u8, u8, u8)]| calls.iter().flat_map(|&(o, m, h)| line(o, m, h)).collect::<Vec<u8>>();
    vec![
        calls(&[
            (2, 2, 0),
            (4, 7, 2),
            (17, 7, 7),
            (9, 7, 1),
            (10, 7, 1),
            (11, 3, 1),
            (13, 7, 1),
            (12, 7, 3),
            (2, 2, 0),
            (6, 7, 2),
            (14, 7, 1),
        ]),
        calls(&[
            (2, 2, 0),
            (2, 3, 0),
            (4, 7, 3),
            (4, 7, 2),
            (17, 7, 7),
            (10, 7, 1),
            (11, 3, 1),
            (10, 7, 1),
            (11, 4, 1),
            (12, 7, 4),
            (12, 7, 4),
        ]),
        calls(&[(16, 7, 0), (17, 7, 7), (14, 7, 1), (15, 7, 0), (10, 7, 1), (13, 7, 1), (9, 7, 0), (4, 7, 1), (6, 7, 1), (12, 7, 0)]),
        calls(&[(2, 4, 0), (4, 7, 4), (17, 7, 7), (11, 5, 1), (11, 6, 1), (12, 7, 5), (4, 7, 4), (6, 7, 4), (12, 7, 6), (10, 7, 5)]),
        calls(&[
            (0, 0, 0),
            (1, 1, 0),
            (2, 2, 0),
            (4, 7, 2),
            (17, 7, 7),
            (9, 7, 1),
            (10, 7, 1),
            (11, 3, 1),
            (13, 7, 1),
            (12, 7, 3),
            (8, 7, 1),
            (7, 7, 0),
        ]),
        calls(&[(0, 0, 0), (2, 1, 0), (2, 2, 0), (7, 7, 0), (4, 7, 1), (6, 7, 2), (6, 7, 2), (12, 7, 1), (2, 3, 0)]),
        // Plane, placement, carving, header; zeros are numbers as they should be.
        [vec![18], vec![0; 45], vec![4, 0, 0, 0, 0, 1, 0, 0, 2, 0, 0, 3]].concat(),
        calls(&[(0, 0, 0), (1, 1, 0), (16, 7, 0), (17, 7, 7), (14, 7, 1), (15, 7, 0), (10, 7, 1)]),
    ]
}
