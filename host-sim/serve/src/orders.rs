//! Orders of pages that wait for the operator: a vent ahead of everything, and one order of each
//! kind.

use super::word::Order;
use std::collections::VecDeque;
use std::mem::discriminant;
use std::sync::{Mutex, MutexGuard, PoisonError};

/// The queue. A page that sends faster than the board answers replaces its own orders and delays no
/// vent.
#[derive(Debug, Default)]
pub struct Orders(Mutex<Waiting>);

#[derive(Debug, Default)]
struct Waiting {
    vent: Option<&'static str>,
    orders: VecDeque<Order>,
}

#[derive(Debug, Clone, PartialEq)]
pub enum Next {
    Vent,
    Order(Order),
}

impl Orders {
    /// A lock poisoned by a panic is still usable: every change is one call.
    fn waiting(&self) -> MutexGuard<'_, Waiting> {
        self.0.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// Adds an order. It replaces an earlier one of its kind, in the earlier one's place.
    pub fn put(&self, order: Order) {
        let mut waiting = self.waiting();
        waiting.orders.retain(|earlier| discriminant(earlier) != discriminant(&order));
        waiting.orders.push_back(order);
    }

    /// Requests a vent before any other order.
    pub fn vent(&self, why: &'static str) {
        self.waiting().vent = Some(why);
    }

    /// The reason for a requested vent.
    pub fn vent_wanted(&self) -> Option<&'static str> {
        self.waiting().vent
    }

    /// Takes the next entry; an order only if `ready`. A vent drops the orders that would move the
    /// muscle.
    pub fn next(&self, ready: bool) -> Option<Next> {
        let mut waiting = self.waiting();
        if waiting.vent.take().is_some() {
            waiting.orders.retain(|order| !order.moves());
            return Some(Next::Vent);
        }
        if ready { waiting.orders.pop_front().map(Next::Order) } else { None }
    }

    /// Drops all orders; returns whether there were any.
    pub fn refuse(&self) -> bool {
        let orders = std::mem::take(&mut self.waiting().orders);
        !orders.is_empty()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use model_core::SetPoint;

    fn set(pressure_pa: f32) -> Order {
        Order::Set(SetPoint::Pressure { pressure_pa })
    }

    #[test]
    fn a_vent_passes_a_thousand_orders_and_drops_those_that_move() {
        let orders = Orders::default();
        (0..1000_u16).for_each(|i| orders.put(set(1.3e5 + f32::from(i))));
        orders.put(Order::Save);
        orders.vent("a test");
        orders.put(Order::Arm { most_pa: None });
        assert_eq!(orders.vent_wanted(), Some("a test"));
        assert_eq!(orders.next(false), Some(Next::Vent), "a board that is behind vents too");
        assert_eq!(orders.vent_wanted(), None);
        assert_eq!(orders.next(false), None);
        assert_eq!(orders.next(true), Some(Next::Order(Order::Save)));
        assert_eq!(orders.next(true), None);
    }

    #[test]
    fn the_last_of_a_kind_counts_and_kinds_keep_their_order() {
        let orders = Orders::default();
        let arm = |most_pa| Order::Arm { most_pa: Some(most_pa) };
        for order in [arm(2e5), Order::Clear, arm(3e5), set(1.3e5), set(1.4e5)] {
            orders.put(order);
        }
        let taken: Vec<Next> = std::iter::from_fn(|| orders.next(true)).collect();
        assert_eq!(taken, [Order::Clear, arm(3e5), set(1.4e5)].map(Next::Order));
        orders.put(Order::Record);
        assert!(orders.refuse() && !orders.refuse());
    }
}
