//! A robot from frame to frame.

use crate::file::{OnUnknown, Robot, Rule, When};
use crate::joints::{JointHistory, JointsAt, KEPT_S};
use crate::kinematics::Posture;
use crate::pose::Pose;
use crate::seam::{Key, Seams, are_faces};
use crate::snapshot::{
    Cause, ContactPart, EventKind, JointTorque, RobotContact, RuleEvent, SkinSnapshot, Snapshot, UnknownReason, Zone,
};
use crate::wrench::Wrench;
use dermis::contact::Contact;
use dermis::geom::vector::norm;
use dermis::pipeline::{PipelineFrame, Timestamp, TrackedContact, Validity};
use serde::{Deserialize, Serialize};
use std::collections::BTreeMap;
use std::sync::Arc;

/// A robot from frame to frame: the newest frame of each skin, joint states, rules. It has no clock, no threads and no input or
/// output: the same calls give the same results.
#[derive(Debug, Clone)]
pub struct RobotState {
    robot: Arc<Robot>,
    joints: JointHistory,
    skins: Vec<SkinState>,
    rules: Vec<RuleState>,
    seams: Seams,
    /// Contacts that touch another skin of the robot, by its index.
    self_touches: BTreeMap<Key, usize>,
    /// When rules were looked at last.
    applied_at: Timestamp,
}

/// What is known of a skin.
#[derive(Debug, Clone, Default)]
struct SkinState {
    frame: Option<Arc<SkinFrame>>,
    /// Why it is unknown whatever its last frame says.
    fault: Option<UnknownReason>,
}

/// The part of a frame that a robot uses.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct SkinFrame {
    /// When it was measured.
    pub measured_at: Timestamp,
    /// Whether the skin is touched.
    #[serde(flatten)]
    pub zone: Zone,
    /// The contacts in the frame of the skin; none of a skin that is unknown.
    pub contacts: Vec<TrackedContact>,
    /// Frames per second.
    pub rate_hz: f64,
    /// Serial number of the device.
    pub device_serial: Option<u32>,
}

impl From<&PipelineFrame> for SkinFrame {
    fn from(frame: &PipelineFrame) -> Self {
        let zone = match (&frame.validity, frame.touched) {
            (Validity::Invalid { reason }, _) => Zone::Unknown { reason: UnknownReason::Invalid(*reason) },
            (Validity::Stale { .. }, _) | (_, None) => Zone::Unknown { reason: UnknownReason::Late },
            (_, Some(true)) => Zone::Touched,
            (_, Some(false)) => Zone::Clear,
        };
        let is_known = !matches!(zone, Zone::Unknown { .. });
        SkinFrame {
            measured_at: frame.measured_at,
            zone,
            contacts: if is_known { frame.contacts.clone() } else { Vec::new() },
            rate_hz: frame.health.rate_hz,
            device_serial: frame.health.device_serial.map(u32::from),
        }
    }
}

/// Whether a rule holds.
#[derive(Debug, Clone, Default)]
struct RuleState {
    cause: Option<Cause>,
    /// Since when it has not held.
    clear_since: Option<Timestamp>,
    /// For each of its skins, whether it held by that skin when the skin was last known.
    held: Vec<bool>,
}

/// What a skin says to a rule.
enum Says {
    Holds,
    Clear,
    Unknown(Option<UnknownReason>),
}

impl RobotState {
    /// A robot of which nothing is known.
    pub fn new(robot: Arc<Robot>) -> Self {
        let absent = || SkinState { frame: None, fault: Some(UnknownReason::Absent) };
        let skins = robot.skins().iter().map(|_| absent()).collect();
        let rule = |rule: &Rule| RuleState { held: vec![false; rule.skins.len()], ..RuleState::default() };
        let rules = robot.rules().iter().map(rule).collect();
        let seams = Seams::new(&robot);
        let self_touches = BTreeMap::new();
        let (joints, applied_at) = (JointHistory::default(), Timestamp::default());
        RobotState { robot, joints, skins, rules, seams, self_touches, applied_at }
    }

    /// The robot.
    pub fn robot(&self) -> &Arc<Robot> {
        &self.robot
    }

    /// Takes positions of joints by name, rad or m, measured at a time.
    ///
    /// # Errors
    /// A position that is not finite or beyond the limits of its joint; joint states without a joint that a skin depends on; times that do not increase; a joint
    /// that has moved much faster than it can. Such states are not used.
    pub fn joints(&mut self, at: Timestamp, positions: &[(&str, f64)]) -> Result<(), String> {
        self.joints.add(&self.robot, at, positions)
    }

    /// Takes a frame of a skin, by index; returns the rules that begin, end or change their reason by it. One that is older than
    /// the one before says nothing.
    ///
    /// # Panics
    /// If the robot has no such skin.
    pub fn frame(&mut self, skin: usize, frame: &PipelineFrame, now: Timestamp) -> Vec<RuleEvent> {
        match frame.validity {
            Validity::Stale { .. } => self.stale(skin, now),
            _ => self.known(skin, frame.into(), now),
        }
    }

    /// The same with the part of a frame that another program has computed.
    ///
    /// # Panics
    /// As there.
    pub fn known(&mut self, skin: usize, frame: SkinFrame, now: Timestamp) -> Vec<RuleEvent> {
        let measured_at = frame.measured_at;
        let state = &mut self.skins[skin];
        let older_s = state.frame.as_ref().map_or(0.0, |last| last.measured_at.seconds_since(measured_at));
        // One that is much older is of a clock that was set back.
        if older_s > 0.0 && older_s < KEPT_S {
            return self.apply_rules(now, now);
        }
        state.frame = Some(Arc::new(frame));
        // Another device stays another one until it is replaced; a frame of a time that is still to come is of another clock.
        let is_ahead = measured_at.seconds_since(now) > self.robot.age_s();
        state.fault = match state.fault {
            Some(UnknownReason::OtherDevice) => Some(UnknownReason::OtherDevice),
            _ => is_ahead.then_some(UnknownReason::Late),
        };
        self.apply_rules(measured_at, now)
    }

    /// Whether the device of a skin is that of another one.
    pub fn is_other_device(&self, skin: usize) -> bool {
        self.skins[skin].fault == Some(UnknownReason::OtherDevice)
    }

    /// The last frame of a skin is stale.
    pub fn stale(&mut self, skin: usize, now: Timestamp) -> Vec<RuleEvent> {
        self.skins[skin].fault.get_or_insert(UnknownReason::Late);
        self.apply_rules(now, now)
    }

    /// A device of a skin is there, with its serial number; 0 if it has none.
    pub fn connected(&mut self, skin: usize, serial: u32, now: Timestamp) -> Vec<RuleEvent> {
        let is_other = self.robot.skins()[skin].serial.is_some_and(|expected| expected != serial);
        let state = &mut self.skins[skin];
        // Frames of the device before say nothing of this one.
        state.frame = None;
        state.fault = Some(if is_other { UnknownReason::OtherDevice } else { UnknownReason::Absent });
        self.apply_rules(now, now)
    }

    /// A skin cannot be read until its next frame.
    pub fn fault(&mut self, skin: usize, reason: UnknownReason, now: Timestamp) -> Vec<RuleEvent> {
        let state = &mut self.skins[skin];
        state.fault = Some(state.fault.filter(|fault| *fault == UnknownReason::OtherDevice).unwrap_or(reason));
        self.apply_rules(now, now)
    }

    /// Time passes: frames become too old, rules end. To be called several times in `age_s`.
    pub fn tick(&mut self, now: Timestamp) -> Vec<RuleEvent> {
        self.apply_rules(now, now)
    }

    /// Whether a skin is touched.
    pub fn zone(&self, skin: usize, now: Timestamp) -> Zone {
        let SkinState { frame, fault } = &self.skins[skin];
        match (fault, frame) {
            (Some(reason), _) => Zone::Unknown { reason: *reason },
            (None, None) => Zone::Unknown { reason: UnknownReason::Absent },
            (None, Some(frame)) => match frame.zone {
                Zone::Unknown { .. } => frame.zone,
                _ if now.seconds_since(frame.measured_at).abs() > self.robot.age_s() => {
                    Zone::Unknown { reason: UnknownReason::Late }
                }
                zone => zone,
            },
        }
    }

    /// Whether any skin is touched; `None` if none is, but a required one is unknown.
    pub fn touched(&self, now: Timestamp) -> Option<bool> {
        let mut zones = (0..self.skins.len()).map(|skin| self.zone(skin, now));
        if zones.any(|zone| zone == Zone::Touched) {
            return Some(true);
        }
        self.is_complete(now).then_some(false)
    }

    /// Whether every required skin is known, and at least one skin.
    pub fn is_complete(&self, now: Timestamp) -> bool {
        let is_known = |skin: usize| !matches!(self.zone(skin, now), Zone::Unknown { .. });
        let mut skins = self.robot.skins().iter().enumerate();
        skins.all(|(skin, worn)| is_known(skin) || !worn.required) && (0..self.skins.len()).any(is_known)
    }

    /// What a skin says to a condition.
    fn says(&self, skin: usize, rule: &Rule, now: Timestamp) -> Says {
        let zone = self.zone(skin, now);
        let all = self.contacts(skin, now);
        let counts = |tracked: &&TrackedContact| {
            !rule.ignores_self || !self.self_touches.contains_key(&(skin, tracked.contact.id))
        };
        let contacts: Vec<&TrackedContact> = all.iter().filter(counts).collect();
        let holds = |holds: bool| if holds { Says::Holds } else { Says::Clear };
        match (zone, rule.when) {
            (Zone::Unknown { reason }, _) => Says::Unknown(Some(reason)),
            // A touch without a contact may be of the world.
            (zone, When::Touched) => holds(zone == Zone::Touched && (all.is_empty() || !contacts.is_empty())),
            (_, When::Contact) => holds(!contacts.is_empty()),
            (_, When::ForceN(force_n)) => {
                if contacts.iter().any(|tracked| tracked.contact.force_n >= force_n) {
                    Says::Holds
                } else if contacts.iter().all(|tracked| tracked.contact.force_is_known())
                    && (zone == Zone::Clear || !all.is_empty())
                {
                    Says::Clear
                } else {
                    Says::Unknown(None)
                }
            }
        }
    }

    /// The contacts of a skin; none of one that is unknown.
    fn contacts(&self, skin: usize, now: Timestamp) -> &[TrackedContact] {
        match (self.zone(skin, now), &self.skins[skin].frame) {
            (Zone::Clear | Zone::Touched, Some(frame)) => &frame.contacts,
            _ => &[],
        }
    }

    /// Finds the contacts of skins on links that move against each other, which lie face to face.
    fn find_self_touches(&self, now: Timestamp) -> BTreeMap<Key, usize> {
        let touched: Vec<usize> = (0..self.skins.len()).filter(|&skin| !self.contacts(skin, now).is_empty()).collect();
        let mut found = BTreeMap::new();
        for (place, &a) in touched.iter().enumerate() {
            for &b in touched[place + 1..].iter().filter(|&&b| !self.seams.are_fixed(a, b)) {
                let seconds = self.in_base(b, now);
                for first in self.in_base(a, now) {
                    for second in seconds.iter().filter(|second| are_faces(&first, second)) {
                        found.insert((a, first.id), b);
                        found.insert((b, second.id), a);
                    }
                }
            }
        }
        found
    }

    /// The contacts of a skin in the frame of the base; none if its pose is unknown.
    fn in_base(&self, skin: usize, now: Timestamp) -> Vec<Contact> {
        let worn = &self.robot.skins()[skin];
        let pose = self.skins[skin].frame.as_deref().and_then(|frame| {
            let (_, posture) = self.posture(frame, now)?;
            Some(posture.pose(self.robot.base_index(), worn.link_index)?.after(&worn.origin))
        });
        let moved = |tracked: &TrackedContact| {
            let (pose, contact) = (pose?, tracked.contact);
            let (position_m, normal) = (pose.point(contact.position_m), pose.vector(contact.normal));
            Some(Contact { position_m, normal, ..contact })
        };
        self.contacts(skin, now).iter().filter_map(moved).collect()
    }

    /// Follows touches over seams, and finds the rules that begin, end or change their reason.
    fn apply_rules(&mut self, measured_at: Timestamp, now: Timestamp) -> Vec<RuleEvent> {
        self.applied_at = now;
        let mut events = Vec::new();
        let mut seams = std::mem::take(&mut self.seams);
        seams.update(&(0..self.skins.len()).map(|skin| self.contacts(skin, now)).collect::<Vec<_>>());
        self.seams = seams;
        self.self_touches = self.find_self_touches(now);
        let robot = Arc::clone(&self.robot);
        for (index, rule) in robot.rules().iter().enumerate() {
            let mut cause: Option<Cause> = None;
            for (place, &skin) in rule.skins.iter().enumerate() {
                let name = || robot.skins()[skin].name.clone();
                let says = self.says(skin, rule, now);
                let held = &mut self.rules[index].held[place];
                let found = match (says, rule.unknown) {
                    (Says::Holds, _) => Some(Cause::Touched { skin: name() }),
                    (Says::Unknown(reason), OnUnknown::Stop) => Some(Cause::Unknown { skin: name(), reason }),
                    (Says::Unknown(reason), OnUnknown::Keep) => {
                        cause = cause.or_else(|| held.then(|| Cause::Unknown { skin: name(), reason }));
                        continue;
                    }
                    (Says::Clear | Says::Unknown(_), _) => None,
                };
                *held = matches!(found, Some(Cause::Touched { .. }));
                // A touch is the better reason.
                cause = if *held { found } else { cause.or(found) };
            }
            let RuleState { cause: active, clear_since, .. } = &mut self.rules[index];
            let event = |event, cause| RuleEvent { rule: rule.name.clone(), event, cause, measured_at, at: now };
            match (cause, &active) {
                (Some(cause), None) => {
                    events.push(event(EventKind::Begins, cause.clone()));
                    (*active, *clear_since) = (Some(cause), None);
                }
                (Some(cause), Some(before)) => {
                    if std::mem::discriminant(&cause) != std::mem::discriminant(before) {
                        events.push(event(EventKind::Changes, cause.clone()));
                    }
                    (*active, *clear_since) = (Some(cause), None);
                }
                (None, Some(_)) => {
                    let since = *clear_since.get_or_insert(now);
                    if now.seconds_since(since) >= rule.clear_s {
                        events.extend(active.take().map(|cause| event(EventKind::Ends, cause)));
                    }
                }
                (None, None) => {}
            }
        }
        events
    }

    /// The pose of each link in the frame of the base, as [`Robot::poses`]; `None` without joint states that are young enough.
    pub fn poses(&self, now: Timestamp) -> Option<Vec<Option<Pose>>> {
        let at = self.joints.at(self.robot.kinematics()?, now, self.robot.age_s())?;
        Some(self.robot.poses(&at.positions))
    }

    /// What is known now, with the rules that hold now.
    pub fn snapshot(&self, now: Timestamp) -> Snapshot {
        if self.applied_at != now {
            let mut then = self.clone();
            then.tick(now);
            return then.snapshot(now);
        }
        let robot = &self.robot;
        let postures: Vec<_> =
            self.skins.iter().map(|skin| skin.frame.as_deref().and_then(|frame| self.posture(frame, now))).collect();
        let mut links: Vec<Wrench> = Vec::new();
        let (mut skins, mut unknown) = (Vec::new(), Vec::new());
        let mut torques = Some(vec![(0.0, 0.0); robot.kinematics().map_or(0, |known| known.movable().len())]);
        for (index, worn) in robot.skins().iter().enumerate() {
            let (zone, frame) = (self.zone(index, now), self.skins[index].frame.as_deref());
            skins.push(SkinSnapshot {
                skin: worn.name.clone(),
                link: worn.link.clone(),
                zone,
                age_s: frame.map(|frame| now.seconds_since(frame.measured_at)),
                rate_hz: frame.map(|frame| frame.rate_hz),
                device_serial: frame.and_then(|frame| frame.device_serial),
            });
            let mut of_skin = Wrench::zero(&worn.link);
            match (zone, frame) {
                (Zone::Clear | Zone::Touched, Some(frame)) => {
                    for tracked in &frame.contacts {
                        if !of_skin.add(&tracked.contact, &worn.origin, robot.friction()) {
                            of_skin.lacks(&worn.name);
                        }
                    }
                    // A touch without a contact has a force that is not known yet.
                    if zone == Zone::Touched && frame.contacts.is_empty() {
                        of_skin.lacks(&worn.name);
                    }
                    torques = torques
                        .filter(|_| of_skin.complete)
                        .and_then(|sum| self.with_torques(sum, index, &postures[index].as_ref()?.1, &of_skin));
                }
                _ => {
                    unknown.push(worn.name.clone());
                    of_skin.lacks(&worn.name);
                    torques = None;
                }
            }
            match links.iter_mut().find(|wrench| wrench.link == worn.link) {
                Some(wrench) => wrench.join(of_skin),
                None => links.push(of_skin),
            }
        }
        let contacts = self.seams.touches().iter().filter_map(|touch| self.contact(touch, &postures, now)).collect();
        let rules = robot.rules().iter().zip(&self.rules);
        Snapshot {
            robot: robot.name().into(),
            at: now,
            base: robot.base().map(String::from),
            touched: self.touched(now),
            complete: self.is_complete(now),
            unknown,
            skins,
            contacts,
            wrenches: links,
            joint_torques: torques.zip(robot.kinematics()).map(|(torques, kinematics)| {
                let of = |(torque_n_m, variance): (f64, f64)| JointTorque { torque_n_m, sd_n_m: variance.sqrt() };
                kinematics.joint_names().map(String::from).zip(torques.into_iter().map(of)).collect()
            }),
            rules: rules.filter_map(|(rule, state)| Some((rule.name.clone(), state.cause.clone()?))).collect(),
            joints_age_s: self.joints.newest().map(|at| now.seconds_since(at)),
        }
    }

    /// The joints when a frame was measured, and the robot then.
    fn posture(&self, frame: &SkinFrame, now: Timestamp) -> Option<(JointsAt, Posture<'_>)> {
        let kinematics = self.robot.kinematics()?;
        let joints = if self.robot.needed_joints().is_empty() {
            // No joint matters: all skins are fixed to the base.
            let count = kinematics.movable().len();
            JointsAt { positions: vec![f64::NAN; count], speeds: vec![0.0; count], gap_s: 0.0 }
        } else {
            // States of a time that is still to come are of another clock.
            let is_ahead = self.joints.newest()?.seconds_since(now) > self.robot.age_s();
            self.joints.at(kinematics, frame.measured_at, self.robot.age_s()).filter(|_| !is_ahead)?
        };
        let posture = kinematics.posture(&joints.positions);
        Some((joints, posture))
    }

    /// A touch, by its contacts; `postures` are those of all skins when their frames were measured.
    fn contact(
        &self,
        touch: &[Key],
        postures: &[Option<(JointsAt, Posture<'_>)>],
        now: Timestamp,
    ) -> Option<RobotContact> {
        let of = |&(skin, id): &Key| {
            let tracked = self.contacts(skin, now).iter().find(|tracked| tracked.contact.id == id)?;
            Some((skin, tracked))
        };
        let parts: Vec<(usize, &TrackedContact)> = touch.iter().filter_map(of).collect();
        let &(skin, oldest) = parts.first()?;
        let mut tracked = if parts.len() == 1 { oldest.clone() } else { self.seams.joined(&parts)? };
        tracked.contact.id = self.seams.id((skin, oldest.contact.id))?;
        let worn = &self.robot.skins()[skin];
        let (base, link) = (self.robot.base_index(), worn.link_index);
        let at = postures[skin].as_ref();
        let pose = at.and_then(|(_, posture)| posture.pose(base, link));
        let contact = &tracked.contact;
        let position_link_m = worn.origin.point(contact.position_m);
        let normal_link = worn.origin.vector(contact.normal);
        let moved_m = at.and_then(|(joints, posture)| {
            let jacobian = posture.jacobian(base, link, position_link_m)?;
            // Joints that are not known do not move this link.
            let speeds: Vec<f64> =
                joints.speeds.iter().map(|speed| if speed.is_nan() { 0.0 } else { *speed }).collect();
            let along = |row: usize| (0..jacobian.columns).map(|joint| jacobian.at(row, joint) * speeds[joint]).sum();
            Some(norm([0, 1, 2].map(along)) * joints.gap_s)
        });
        let name = |skin: usize| self.robot.skins()[skin].name.clone();
        let part = |(skin, part): &(usize, &TrackedContact)| ContactPart { skin: name(*skin), id: part.contact.id };
        Some(RobotContact {
            skin: worn.name.clone(),
            link: worn.link.clone(),
            position_link_m,
            normal_link,
            position_base_m: pose.map(|pose| pose.point(position_link_m)),
            normal_base: pose.map(|pose| pose.vector(normal_link)),
            sd_base_m: moved_m.filter(|_| contact.sd_m.is_finite()).map(|moved_m| contact.sd_m.hypot(moved_m)),
            pose_base: pose.map(|pose| pose.after(&worn.origin)),
            self_link: touch
                .iter()
                .find_map(|key| self.self_touches.get(key).map(|&other| self.robot.skins()[other].link.clone())),
            parts: parts.iter().map(part).collect(),
            contact: tracked,
        })
    }

    /// The torques with those of a skin's wrench; `None` if its pose is unknown.
    fn with_torques(
        &self,
        mut sum: Vec<(f64, f64)>,
        skin: usize,
        posture: &Posture<'_>,
        wrench: &Wrench,
    ) -> Option<Vec<(f64, f64)>> {
        // Of the tree's root, which stands still: contacts may be given in the frame of another link.
        let link = self.robot.skins()[skin].link_index;
        let root = self.robot.kinematics()?.root_of(link);
        let pose = posture.pose(root, link)?;
        let jacobian = posture.jacobian(root, link, [0.0; 3])?;
        for ((torque, variance), (more, spread)) in sum.iter_mut().zip(wrench.torques(&jacobian, &pose)) {
            (*torque, *variance) = (*torque + more, *variance + spread);
        }
        Some(sum)
    }
}
